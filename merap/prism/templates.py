"""Fill in the templates, and break long lines."""

from __future__ import annotations

import re
import textwrap
from functools import lru_cache
from importlib.resources import files
from itertools import accumulate

import jinja2

WIDTH = 120
_GLUE = "\0"
_UNBROKEN = re.compile(r" \? | :|\([^()?|]*\)")


def fill_in(template: str, **content: object) -> str:
    """Fill in a template, and break long lines."""
    rendered = _environment().get_template(template).render(content)
    return "\n".join(_wrapped(line) for line in rendered.rstrip("\n").split("\n")) + "\n"


def _wrapped(line: str) -> str:
    """A long line broken where a sum has its terms, then at spaces; comments break where they are made."""
    if len(line) <= WIDTH or line.lstrip().startswith("//"):
        return line
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    terms = _terms(line)
    lines = [terms[0], *(f"{indent}+ {term}" for term in terms[1:])]
    return "\n".join(_filled(part, indent + "  ") for part in lines)


def _filled(line: str, indent: str) -> str:
    """The line broken at spaces, but not within a box nor between a case and its value."""
    kept = _UNBROKEN.sub(lambda found: found[0].replace(" ", _GLUE), line)
    filled = textwrap.fill(
        kept, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return filled.replace(_GLUE, " ")


def _terms(line: str) -> list[str]:
    """The line cut at each ` + ` outside parentheses."""
    depths = list(accumulate((char == "(") - (char == ")") for char in line))
    cuts = [cut.start() for cut in re.finditer(r" \+ ", line) if depths[cut.start()] == 0]
    starts = [0, *(cut + 3 for cut in cuts)]
    return [line[start:stop] for start, stop in zip(starts, [*cuts, len(line)], strict=True)]


@lru_cache(maxsize=1)
def _environment() -> jinja2.Environment:
    """Return the templates, loaded once."""
    sources = {
        entry.name: entry.read_text(encoding="utf-8")
        for entry in files("prism_templates").iterdir()
        if entry.name.endswith(".j2")
    }
    return jinja2.Environment(
        loader=jinja2.DictLoader(sources),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
