"""Read YAML 1.2 strictly.

Only what JSON has too is let through: mappings with text keys, sequences, text, numbers,
truth values and null. Mappings become dicts, sequences tuples. What can go wrong becomes an
`InputError` with file, line and key.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.docinfo import DocInfo
from ruamel.yaml.error import MarkedYAMLError, ReusedAnchorWarning, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from merap.concerns.document import Document
from merap.errors import InputError

MAX_BYTES = 4 * 2**20
MAX_NODES = 1_000_000
MAX_NUMBER = 1e15
MAX_OPEN_BRACKETS = 200
MAX_DEPTH = 100
OLD_VERSION = "1.1"
VERSIONS = (OLD_VERSION, "1.2")
_WRONG_VERSION = f"YAML: expected version {' or '.join(VERSIONS)}"
_TAG = "tag:yaml.org,2002:"


def read_document(path: Path) -> Document:
    """Read and parse `path`.

    Raises:
        InputError: the file is missing, no regular file, above `MAX_BYTES`, not UTF-8, not
            YAML, not a mapping, has a key twice, or aliases that expand without end.
    """
    source = str(path)
    content = _read(path)
    text = _decode(content, source)
    root = _compose(text, source)
    if not isinstance(root, MappingNode):
        raise InputError("expected a mapping of keys to values at the top level", source=source, line=1)
    return Document(source, content, root, _Builder(source, _version(text, source)).build(root))


def read_value(text: str, source: str, key: str) -> Any:
    """Parse YAML that stands on the command line; None if it is empty.

    Args:
        text: of one value.
        source: where it stands, for messages.
        key: what it is the value of, for messages.

    Raises:
        InputError: as `read_document` does.
    """
    try:
        root = _compose(text, source)
        return None if root is None else _Builder(source, _version(text, source)).build(root)
    except InputError as error:
        message = f"{error.message}, got {_shortened(text)!r}"
        raise InputError(message, source=source, key=key) from error


def _read(path: Path) -> bytes:
    source = str(path)
    try:
        if path.is_dir():
            raise InputError("is a folder, expected a YAML file", source=source)
        if not path.exists():
            raise InputError("no such file", source=source)
        if not path.is_file():
            raise InputError("is not a regular file", source=source)
        if (size := path.stat().st_size) > MAX_BYTES:
            raise InputError(f"has {size} bytes, at most {MAX_BYTES} are allowed", source=source)
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"can't be read: {error}", source=source) from error


def _decode(content: bytes, source: str) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"is not UTF-8: {error.reason}", source=source, line=line) from error


def _check_brackets(text: str, source: str) -> None:
    """Refuse deeply nested flow collections, for which the scanner takes quadratic time."""
    depth = 0
    for match in re.finditer(r"[\[\]{}]", text):
        depth += 1 if match[0] in "[{" else -1
        if depth > MAX_OPEN_BRACKETS:
            line = text.count("\n", 0, match.start()) + 1
            raise InputError(f"YAML: more than {MAX_OPEN_BRACKETS} open brackets", source=source, line=line)


def _version(text: str, source: str) -> str:
    """Return the version of YAML that a text declares.

    Raises:
        InputError: it is no version that can be read.
    """
    version = VERSIONS[-1]
    for number, line in enumerate(text.splitlines(), 1):
        if declared := re.match(r"\ufeff?%YAML[ \t]+(\d+\.\d+)(?![\d.])", line):
            version = declared[1]
            if version not in VERSIONS:
                raise InputError(f"{_WRONG_VERSION}, not {_shortened(version)}", source=source, line=number)
    return version


def _compose(text: str, source: str) -> Node | None:
    """Return the graph of nodes, None for an empty text; aliases in it do not expand without end."""
    _check_brackets(text, source)
    _version(text, source)
    loader = YAML(typ="safe", pure=True)
    loader.doc_infos.append(DocInfo())
    try:
        constructor, _ = loader.get_constructor_parser(text)
        with warnings.catch_warnings():
            # An anchor may stand twice; the later one counts.
            warnings.simplefilter("ignore", ReusedAnchorWarning)
            node: Node | None = constructor.composer.get_single_node()
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        raise InputError(f"YAML: {error.problem or error.context}", source=source, line=line) from error
    except ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(f"YAML: {error.reason}", source=source, line=line) from error
    except YAMLError as error:
        raise InputError(f"YAML: {error}", source=source) from error
    except RecursionError as error:
        raise InputError("YAML: nested too deeply", source=source) from error
    # The parser lets pass on what `chr` and its own checks of versions raise.
    except (ValueError, OverflowError, AssertionError, KeyError) as error:
        is_version = isinstance(error, AssertionError | KeyError)
        message = _WRONG_VERSION if is_version else "YAML: an escape in quotes stands for no character"
        raise InputError(message, source=source, line=loader.reader.line + 1) from error
    if node is None:
        return None
    _check_expansion(node, source)
    return node


def _children(node: Node) -> list[Node]:
    if isinstance(node, MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, SequenceNode) else []


def _check_expansion(root: Node, source: str) -> None:
    """Refuse aliases that contain themselves, and what is too large or too deep once they are expanded.

    Sizes are counted bottom up on the node graph, where an alias is a second edge to one
    node: nothing is expanded.
    """
    sizes: dict[int, int] = {}
    depths: dict[int, int] = {}
    pending: set[int] = set()
    stack = [(root, False)]
    while stack:
        node, ready = stack.pop()
        if ready:
            pending.discard(id(node))
            sizes[id(node)] = 1 + sum(sizes[id(child)] for child in _children(node))
            depths[id(node)] = 1 + max((depths[id(child)] for child in _children(node)), default=0)
            if depths[id(node)] > MAX_DEPTH:
                line = node.start_mark.line + 1
                raise InputError(f"YAML: nested deeper than {MAX_DEPTH} levels", source=source, line=line)
            if sizes[id(node)] > MAX_NODES:
                raise InputError(
                    f"the aliases below here expand to more than {MAX_NODES} values",
                    source=source,
                    line=node.start_mark.line + 1,
                )
        elif id(node) in pending:
            raise InputError(
                f"the anchor {node.anchor!r} contains an alias of itself, so it expands without end",
                source=source,
                line=node.start_mark.line + 1,
            )
        elif id(node) not in sizes:
            pending.add(id(node))
            stack.append((node, True))
            stack.extend((child, False) for child in _children(node))


class _Builder:
    """Turn nodes into data; a node that several aliases share is built once."""

    def __init__(self, source: str, version: str) -> None:
        self.source = source
        self.is_old = version == OLD_VERSION
        self.built: dict[int, Any] = {}

    def build(self, node: Node) -> Any:
        if id(node) not in self.built:
            self.built[id(node)] = self._value(node)
        return self.built[id(node)]

    def _value(self, node: Node) -> Any:
        tag = str(node.tag).removeprefix(_TAG)
        if isinstance(node, MappingNode) and tag == "map":
            return self._mapping(node)
        if isinstance(node, SequenceNode) and tag == "seq":
            return tuple(self.build(child) for child in node.value)
        if isinstance(node, ScalarNode) and tag in _SCALARS:
            return self._scalar(node, tag)
        raise self._error(node, f"the YAML tag {tag} is not allowed; put text that looks like one in quotes")

    def _mapping(self, node: MappingNode) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = self.build(key_node) if key_node.tag == f"{_TAG}str" else None
            if not isinstance(key, str):
                shown = getattr(key_node, "value", "") if isinstance(key_node, ScalarNode) else "a collection"
                raise self._error(key_node, f"the key {_shortened(shown)!r} is not text; put it in quotes")
            if key in mapping:
                raise self._error(key_node, f"the key {_shortened(key)!r} stands twice in one mapping")
            mapping[key] = self.build(value_node)
        return mapping

    def _scalar(self, node: ScalarNode, kind: str) -> Any:
        text = node.value
        try:
            value = _SCALARS[kind](text)
        except UnicodeDecodeError as error:
            raise self._error(node, "half of a surrogate pair is not text") from error
        except (ValueError, KeyError) as error:
            shown = repr(_shortened(text))
            if kind == "bool":
                word = f"a truth value in YAML {OLD_VERSION} only" if self.is_old else "no truth value"
                message = f"{shown} is {word}; write true or false, or put it in quotes"
                raise self._error(node, message) from error
            raise self._error(node, f"{shown} can't be read as a number") from error
        if kind == "int" and self.is_old and re.match(r"[-+]?0[0-7_]+$", text):
            message = f"{_shortened(text)} is another number in YAML {OLD_VERSION} than in 1.2"
            raise self._error(node, f"{message}; write it without the 0 in front")
        if kind in ("int", "float") and not abs(value) <= MAX_NUMBER:
            raise self._error(node, f"{_shortened(text)} is not a number of size at most {MAX_NUMBER:g}")
        return value

    def _error(self, node: Node, message: str) -> InputError:
        return InputError(message, source=self.source, line=node.start_mark.line + 1)


def _joined(text: str) -> str:
    """Text with the surrogate pairs that JSON escapes a character with as that character."""
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le")


def _integer(text: str) -> int:
    digits = text.replace("_", "")
    prefixed = digits.lstrip("+-")[:2].lower() in ("0x", "0o", "0b")
    return int(digits, 0) if prefixed else int(digits)


_SCALARS: Mapping[str, Callable[[str], Any]] = {
    "str": lambda text: text if text.isascii() else _joined(text),
    "int": _integer,
    "float": lambda text: float(text.replace("_", "").replace(".inf", "inf").replace(".nan", "nan")),
    "bool": lambda text: {"true": True, "false": False}[text.lower()],
    "null": lambda text: None,
}


def _shortened(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:40]}..."
