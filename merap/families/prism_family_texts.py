"""Read the PRISM texts and templates of a case; fill templates in; read what comes out into programs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from merap.checker.prism_model import PrismModel
from merap.checker.prism_reading import prism_file, read_prism_text
from merap.concerns.document import Document
from merap.concerns.expression_names import CONCERNS
from merap.concerns.schema_program import ProgramSpec, TextSpec
from merap.errors import InputError
from merap.mdp.short_repr import ShortRepr
from merap.prism.user_templates import fill_in_template, template_names
from merap.program.expressions import Value
from merap.program.form import ConcernName

_HEADER = "mdp\n"
_MODULE = re.compile(r"^\s*module\s+(\w+)", re.MULTILINE)


@dataclass(frozen=True, repr=False)
class TextSource(ShortRepr):
    """A text, or the template of one.

    Attributes:
        name: where it stands, for messages.
        content: as written.
        concern: whose template it is; None: it is the text itself.
    """

    name: str
    content: str = field(repr=False)
    concern: ConcernName | None = None


@dataclass(frozen=True, repr=False)
class PrismText(ShortRepr):
    """A whole text, made of parts."""

    parts: tuple[TextSource, ...]

    @property
    def is_whole(self) -> bool:
        """Whether it was written as one text."""
        return self.parts[0].concern is None

    @cached_property
    def text(self) -> str:
        """The text."""
        joined = "".join(
            part.content if part.content.endswith("\n") else f"{part.content}\n" for part in self.parts
        )
        return joined if self.is_whole else _HEADER + joined

    @property
    def owners(self) -> Mapping[str, ConcernName]:
        """The modules of each concern's template."""
        return {
            name: part.concern
            for part in self.parts
            if part.concern
            for name in _MODULE.findall(part.content)
        }

    def read(self, name: str) -> PrismModel:
        """Read the text; raises as `read_prism_text`, in the words of the part that is wrong.

        Args:
            name: of the program.
        """
        source = ", ".join(part.name for part in self.parts)
        try:
            return read_prism_text(self.text, name, source)
        except InputError as error:
            if self.is_whole or error.line is None:
                raise
            line = error.line - 1
            for part in self.parts:
                count = len(part.content.splitlines())
                if line <= count:
                    message = f"{error.message} (line {line} of the text that the template gives)"
                    raise InputError(message, source=part.name) from error
                line -= count
            raise


@dataclass(frozen=True, eq=False, repr=False)
class ProgramSources(ShortRepr):
    """The files of a case.

    Attributes:
        parts: one text, or a template for each concern.
        standalone: the case file with the content of the others put in.
        digest: hexadecimal SHA-256 of all of them.
    """

    parts: tuple[TextSource, ...]
    standalone: bytes = field(repr=False)
    digest: str

    @cached_property
    def names(self) -> frozenset[str]:
        """The names that templates read.

        Raises:
            InputError: a syntax error of a template, with file and line.
        """
        found: set[str] = set()
        for part in self.parts:
            if part.concern is not None:
                with _in(part):
                    found |= template_names(part.content)
        return frozenset(found)

    def filled(self, values: Mapping[str, Value], open_: frozenset[str]) -> PrismText:
        """Return the text under values of constants and parameters.

        Args:
            values: name -> value.
            open_: parameters without a value.

        Raises:
            BranchingError: a template needs the value of a parameter that has none.
            InputError: a template can't be filled in.
        """
        parts = []
        for part in self.parts:
            if part.concern is None:
                return PrismText((part,))
            with _in(part):
                parts.append(
                    TextSource(part.name, fill_in_template(part.content, values, open_), part.concern)
                )
        return PrismText(tuple(parts))


@contextmanager
def _in(part: TextSource) -> Iterator[None]:
    """Give errors raised inside the place that they have in a template."""
    try:
        yield
    except InputError as error:
        raise InputError(error.message, source=part.name, line=error.line) from error


def read_sources(file: Path, document: Document, spec: ProgramSpec) -> ProgramSources:
    """Read the texts that a case file names, or holds.

    Raises:
        InputError: a file can't be read.
    """
    running = hashlib.sha256(document.content)
    program = dict(document.data["program"])

    def source(key: str, given: str | TextSpec, concern: ConcernName | None) -> TextSource:
        if isinstance(given, TextSpec):
            return TextSource(f"{file}: program.{key}.text", given.text, concern)
        path = file.parent / given
        content = prism_file(path)
        running.update(content.encode())
        return TextSource(str(path), content, concern)

    if spec.file is not None:
        parts: tuple[TextSource, ...] = (source("file", spec.file, None),)
        program["file"] = {"text": parts[0].content}
    else:
        templates = spec.templates or {}
        parts = tuple(
            source(f"templates.{concern}", templates[concern], concern)
            for concern in CONCERNS
            if concern in templates
        )
        program["templates"] = {part.concern: {"text": part.content} for part in parts}
    standalone = document.content
    if program != document.data["program"]:
        standalone = json.dumps({**document.data, "program": program}, indent=2).encode()
    return ProgramSources(parts, standalone, running.hexdigest())
