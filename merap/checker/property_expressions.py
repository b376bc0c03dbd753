"""Turn parts of properties that read variables and constants alone into expressions."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import cast

from lark import Token, Tree

from merap.checker.property_file import Node
from merap.errors import InputError
from merap.program.expressions import ARITIES, Constant, Expression, Operation, Variable, fold

# Everything below these is a matter of states and paths, or of a label.
_PLAIN = frozenset(
    ("binary", "unary", "minus", "power", "choose", "call", "brackets", "number", "truth", "name")
)

_SYMBOLS = {"minus": "neg", "power": "pow", "choose": "?:"}


def is_expression(tree: Node) -> bool:
    """Return whether a tree reads nothing but variables and constants."""
    return all(part.data in _PLAIN for part in tree.iter_subtrees())


def expression(tree: Node) -> Expression:
    """Return such a tree as an expression.

    Raises:
        InputError: a function that is not there, or has another number of arguments.
    """
    children = tree.children
    match tree.data:
        case "brackets":
            return expression(children[0])
        case "number" | "truth" | "name":
            return _leaf(tree.data, cast("Token", children[0]))
        case "call":
            return _call(str(children[0]), tuple(map(expression, children[1:])))
    parts = tuple(expression(one) for one in children if isinstance(one, Tree))
    symbol = _SYMBOLS.get(tree.data) or next(str(one) for one in children if isinstance(one, Token))
    return Operation(symbol, parts)


def _leaf(kind: str, token: Token) -> Expression:
    if kind == "name":
        return Variable(str(token), token.column or 1)
    return Constant(Fraction(str(token)) if kind == "number" else str(token) == "true")


def _call(function: str, arguments: tuple[Expression, ...]) -> Expression:
    if function == "round":
        half = Operation("+", (arguments[0], Constant(Fraction(1, 2))))
        return Operation("floor", (half,))
    if function not in ARITIES:
        raise InputError(f"{function}(..) is not supported")
    if len(arguments) not in ARITIES[function]:
        raise InputError(f"{function}(..) does not take {len(arguments)} argument(s)")
    return Operation(function, arguments)


def number(tree: Node, constants: Mapping[str, Fraction | bool], what: str) -> Fraction:
    """Compute a number from constants.

    Raises:
        InputError: it reads something else, or is undefined.
    """
    if not is_expression(tree):
        raise InputError(f"{what} must be a number")
    for name in (str(one.children[0]) for one in tree.find_data("name")):
        if name not in constants:
            raise InputError(f"{what} reads {name!r}, which is no constant")
    found = fold(expression(tree), dict(constants))
    if not isinstance(found, Constant) or isinstance(found.value, bool):
        raise InputError(f"{what} must be a number")
    return found.value


def as_tree(value: Fraction | bool) -> Node:
    """Return a number or truth value as a tree."""
    if isinstance(value, bool):
        return Tree("truth", [Token("TRUTH", str(value).lower())])
    quotient = Tree("number", [Token("NUMBER", str(abs(value.numerator)))])
    if value.denominator != 1:
        divisor = Tree("number", [Token("NUMBER", str(value.denominator))])
        quotient = Tree("binary", [quotient, Token("TIMES", "/"), divisor])
    return Tree("brackets", [Tree("minus", [quotient]) if value < 0 else quotient])
