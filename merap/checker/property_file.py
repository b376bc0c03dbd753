"""Read properties: a file or a text in PRISM's language, with its own constants and labels."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, cast

from lark import Token, Tree, UnexpectedInput, UnexpectedToken

from merap.checker.prism_model import ConstantType
from merap.checker.property_grammar import parser
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.errors import InputError, shortened
from merap.program.names import suggestion

Node: TypeAlias = Tree[Any]
MAX_SHOWN = 60
# These forms belong to Storm's language, not to PRISM's.
_OTHER_LOGIC = re.compile(r"(?P<quantile>\bquantile\()|(?P<conditional>\|\|)|(?P<cost>\b[FGUC]\{)")
_NAMED = {"quantile": "quantile(..)", "conditional": "a || b", "cost": "a bound on rewards"}


@dataclass(frozen=True)
class Property:
    """One property.

    Attributes:
        name: as the file calls it, else its text.
        text: as written, in one line.
        tree: parsed; labels and other properties that it names are put in.
        line: its first line, from 1 on.
    """

    name: str
    text: str
    tree: Node
    line: int


@dataclass(frozen=True)
class PropertyFile:
    """Properties, and the constants that they share.

    Attributes:
        properties: in the file's order.
        constants: name -> its type, None where none is stated, and its definition, None where it is open.
    """

    properties: tuple[Property, ...] = ()
    constants: Mapping[str, tuple[ConstantType | None, Node | None]] = field(default_factory=dict)


def read_properties(text: str, source: str | None = None) -> PropertyFile:
    """Parse properties.

    Args:
        text: one property, or the content of a file.
        source: the file, for messages; None for a property given by itself.

    Raises:
        InputError: a syntax error, or a name that is declared twice; names line and column.
    """
    try:
        tree = parser().parse(text)
    except UnexpectedInput as error:
        if (other := _OTHER_LOGIC.search(text)) is not None:
            assert other.lastgroup is not None
            raise UnsupportedPropertyError(
                f"Storm has no single value for it with bounds: {_NAMED[other.lastgroup]}"
            ) from error
        raise _syntax_error(error, text, source) from error
    except RecursionError as error:
        raise InputError("the properties are nested too deeply", source=source) from error
    constants: dict[str, tuple[ConstantType | None, Node | None]] = {}
    labels: dict[str, Node] = {}
    for part in tree.children:
        if isinstance(part, Tree) and part.data == "constant":
            kind, name, definition = cast("tuple[ConstantType | None, Token, Node | None]", part.children)
            _declare(constants, str(name), (kind, definition), source, name)
        elif isinstance(part, Tree) and part.data == "label":
            name, definition = cast("tuple[Token, Node]", part.children)
            _declare(labels, str(name), definition, source, name)
    given = [
        cast("tuple[Token | None, Node]", tuple(part.children))
        for part in tree.children
        if isinstance(part, Tree) and part.data == "property"
    ]
    named = dict(labels)
    for title, formula in given:
        if title is not None:
            _declare(named, str(title), formula, source, title)
    return PropertyFile(tuple(_property(*one, text, named) for one in given), constants)


def _property(name: Token | None, formula: Node, text: str, named: Mapping[str, Node]) -> Property:
    written = _written(formula, text)
    return Property(
        written if name is None else name.strip('"'),
        written,
        _resolved(formula, named, () if name is None else (str(name),)),
        formula.meta.line,
    )


def read_property(text: str, model: str) -> Property:
    """Parse one property of a model that messages name.

    Raises:
        InputError: a syntax error, or none, or several.
    """
    place = f"{model}: property {text!r}"
    try:
        file = read_properties(text)
    except InputError as error:
        raise InputError(f"{place}: {error.message}") from error
    except UnsupportedPropertyError as error:
        raise UnsupportedPropertyError(f"{place}: {error}") from error
    if len(file.properties) != 1:
        raise InputError(f"{place}: holds {len(file.properties)} properties, expected 1")
    found = file.properties[0]
    for name in names_in(found.tree):
        if name in file.constants and file.constants[name][1] is None:
            raise InputError(f"{place}: constant {name!r} has no value")
    values = {name: definition for name, (_, definition) in file.constants.items()}
    return replace(found, tree=with_constants(found.tree, values))


def _written(formula: Node, text: str) -> str:
    lines = text[formula.meta.start_pos : formula.meta.end_pos].splitlines()
    return " ".join(" ".join(line.split("//")[0] for line in lines).split())


def _declare(known: dict[str, Any], name: str, value: Any, source: str | None, place: Token | int) -> None:
    if name in known:
        line = place if isinstance(place, int) else place.line
        raise InputError(f"{name} is declared twice", source=source, line=line)
    known[name] = value


def _resolved(tree: Node, named: Mapping[str, Node], within: tuple[str, ...]) -> Node:
    """Put labels and properties in where they are named."""
    if tree.data == "label_name":
        name = str(tree.children[0])
        if name not in named:
            return tree
        if name in within:
            raise InputError(f"{name} is defined by itself")
        return _resolved(named[name], named, (*within, name))
    parts = [_resolved(part, named, within) if isinstance(part, Tree) else part for part in tree.children]
    return Tree(tree.data, parts, tree.meta)


def with_constants(tree: Node, values: Mapping[str, Node | None]) -> Node:
    """Return the tree with definitions in place of constants; these may use others in turn."""
    if tree.data == "name" and (definition := values.get(str(tree.children[0]))) is not None:
        return with_constants(definition, values)
    parts = [with_constants(part, values) if isinstance(part, Tree) else part for part in tree.children]
    return Tree(tree.data, parts, tree.meta)


def names_in(tree: Node) -> set[str]:
    """Return the names of constants, variables and formulas that a tree reads."""
    return {str(found.children[0]) for found in tree.find_data("name")}


def chosen(file: PropertyFile, names: tuple[str, ...]) -> PropertyFile:
    """Return the file with those properties alone that are named, by name or by number from 1 on.

    Raises:
        InputError: there is no such property, or none at all.
    """
    if not file.properties:
        raise InputError("there are no properties")
    by_name = {one.name: one for one in file.properties}
    by_name |= {str(number): one for number, one in enumerate(file.properties, 1)}
    if not names:
        return file
    for name in names:
        if name not in by_name:
            known = [shortened(one.name, MAX_SHOWN) for one in file.properties]
            raise InputError(f"no property is called {name!r}{suggestion(name, known)}")
    return PropertyFile(tuple(by_name[name] for name in names), file.constants)


def _syntax_error(error: UnexpectedInput, text: str, source: str | None) -> InputError:
    lines = text.splitlines() or [""]
    at_end = isinstance(error, UnexpectedToken) and error.token.type == "$END"
    line, column = (len(lines), len(lines[-1]) + 1) if at_end else (error.line, error.column)
    shown = shortened(lines[line - 1][max(0, column - 1) :], MAX_SHOWN)
    here = f"here: {shown}" if shown else "at the end"
    return InputError(
        f"syntax error at column {column}, {here}", source=source, line=line if source else None
    )
