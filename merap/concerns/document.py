"""The content of a YAML file, and where each part of it stands."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from merap.errors import InputError

KeyPath: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True, eq=False)
class Document:
    """A YAML file: its content and where each part of it stands.

    Attributes:
        source: the file's name, as messages show it.
        content: its bytes.
        root: the composed node graph; `None` for a document without one.
        data: the root mapping.
        mounts: documents whose content stands in for a key of this one.
    """

    source: str
    content: bytes = field(repr=False)
    root: Node | None = field(repr=False)
    data: Mapping[str, Any] = field(repr=False)
    mounts: Mapping[str, Document] = field(default_factory=dict, repr=False)

    def with_mount(self, key: str, document: Document) -> Document:
        """The same with `document`'s content in place of the value of `key`."""
        data = {**self.data, key: document.data}
        return Document(self.source, self.content, self.root, data, {**self.mounts, key: document})

    @property
    def standalone(self) -> bytes:
        """The same as one file: the content as it is, or, where files are mounted, JSON, which is YAML."""
        if not self.mounts:
            return self.content
        return json.dumps(self.data, indent=2).encode()

    def error(self, path: KeyPath, message: str) -> InputError:
        """An error about the value at `path`, or about what is nearest to it."""
        if path and path[0] in self.mounts:
            mounted = self.mounts[str(path[0])]
            inner = mounted.error(path[1:], message)
            shown = existing_path(mounted.data, path[1:])
            return InputError(
                message, source=mounted.source, line=inner.line, key=key_text((path[0], *shown))
            )
        shown = existing_path(self.data, path)
        return InputError(message, source=self.source, line=self._line(shown), key=key_text(shown) or None)

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """Give errors raised inside that have no place yet the place `path`."""
        try:
            yield
        except InputError as error:
            if error.source is not None:
                raise
            raise self.error(path, error.message) from error

    @contextmanager
    def told(self, path: KeyPath, whose: str) -> Iterator[None]:
        """Give errors raised inside the place `path`, and say of which configurations they are."""
        try:
            yield
        except InputError as error:
            raise self.error(path, f"{error.message} ({whose})") from error

    def line_of(self, path: KeyPath) -> tuple[int, int]:
        """(which file, line) of `path`, to sort by position."""
        if path and path[0] in self.mounts:
            return 1, self.mounts[str(path[0])]._line(path[1:])
        return 0, self._line(path)

    def _line(self, path: KeyPath) -> int:
        """The line of the last part of `path` that exists, counted from 1."""
        node, mark = self.root, None
        for part in path:
            node, mark = _child(node, part, mark)
            if node is None:
                break
        if mark is None:
            return 1
        return int(mark.line) + 1


def key_text(path: KeyPath) -> str:
    """`("space", "edges", 3)` as `space.edges[3]`; keys that are no plain word in quotes."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{_plain(part)}" for part in path)
    return text.removeprefix(".")


def _plain(key: str) -> str:
    return key if re.fullmatch(r"[\w -]{1,80}", key, re.ASCII) else repr(key[:80])


def existing_path(data: Any, path: KeyPath) -> KeyPath:
    """The longest beginning of `path` that leads somewhere in `data`."""
    for length, part in enumerate(path):
        if not _has(data, part):
            return path[:length]
        data = data[part]
    return path


def _has(data: Any, part: str | int) -> bool:
    if isinstance(data, Mapping):
        return part in data
    return isinstance(data, tuple) and isinstance(part, int) and part < len(data)


def _child(node: Node | None, part: str | int, mark: Any) -> tuple[Node | None, Any]:
    """The node below `node` at `part` and the mark of its key, or (None, `mark`)."""
    if isinstance(node, MappingNode):
        for key, value in node.value:
            if key.value == part:
                return value, key.start_mark
    elif isinstance(node, SequenceNode) and isinstance(part, int) and part < len(node.value):
        return node.value[part], node.value[part].start_mark
    return None, mark
