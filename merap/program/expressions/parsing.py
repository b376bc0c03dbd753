"""Parse expressions in PRISM's syntax, and check their types."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from fractions import Fraction

from lark import Token, Transformer, UnexpectedInput, UnexpectedToken, v_args
from lark.exceptions import VisitError

from merap.errors import InputError
from merap.program.expressions.grammar import ARITIES, parser
from merap.program.expressions.operators import bounded
from merap.program.expressions.text import render
from merap.program.expressions.tree import IN, Constant, Expression, Kind, Lookup, Operation, Variable, parts
from merap.program.names import suggestion

MAX_LENGTH = 10_000
MAX_DEPTH = 100
MAX_DIGITS = 50


@v_args(inline=True)
class _Builder(Transformer[Token, Expression]):
    def number(self, token: Token) -> Expression:
        if len(token) > MAX_DIGITS:
            raise InputError(f"the number at column {token.column} has more than {MAX_DIGITS} digits")
        return Constant(bounded(Fraction(str(token))))

    def true(self) -> Expression:
        return Constant(True)

    def false(self) -> Expression:
        return Constant(False)

    def variable(self, token: Token) -> Expression:
        return Variable(str(token), token.column or 1)

    def negate(self, argument: Expression) -> Expression:
        return Operation("neg", (argument,))

    def unary(self, symbol: Token, argument: Expression) -> Expression:
        return Operation(str(symbol), (argument,))

    def binary(self, left: Expression, symbol: Token, right: Expression) -> Expression:
        return Operation(str(symbol), (left, right))

    def choose(self, *arguments: Expression) -> Expression:
        return Operation("?:", arguments)

    def cell(self, row: Token, column: Token) -> Expression:
        return Operation("cell", (self.number(row), self.number(column)))

    def several(self, *places: Expression) -> Expression:
        return Operation("several", places)

    def at(self, function: Token, places: Expression) -> Expression:
        if isinstance(places, Operation) and places.operator == "several":
            return Operation(str(function), places.arguments)
        return Operation(str(function), (places,))

    def call(self, function: Token, *arguments: Expression) -> Expression:
        allowed = ARITIES[str(function)]
        if len(arguments) not in allowed:
            count = f"{allowed.start}" if len(allowed) == 1 else f"at least {allowed.start}"
            raise InputError(
                f"{function} at column {function.column} takes {count} argument(s), got {len(arguments)}"
            )
        return Operation(str(function), arguments)


def parse(text: str) -> Expression:
    """Parse `text`.

    Raises:
        InputError: a syntax error, with its column.
    """
    if len(text) > MAX_LENGTH:
        raise InputError(f"an expression has {len(text)} characters, at most {MAX_LENGTH} are allowed")
    try:
        expression: Expression = _Builder().transform(parser().parse(text))
    except UnexpectedInput as error:
        ends = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        column = len(text) + 1 if ends else error.column
        raise InputError(f"syntax error at column {column} of {_around(text, column)}") from error
    except VisitError as error:
        if isinstance(error.orig_exc, InputError):
            raise InputError(f"{error.orig_exc.message} in {_around(text, 1)}") from error
        raise
    except RecursionError as error:
        raise InputError(f"the expression is nested too deeply: {_around(text, 1)}") from error
    if _depth(expression) > MAX_DEPTH:
        raise InputError(f"the expression is nested deeper than {MAX_DEPTH}: {_around(text, 1)}")
    return expression


def _around(text: str, column: int) -> str:
    """The text in quotes; of a long one the part around a column."""
    first = max(0, min(column - 40, len(text) - 80))
    part = text[first : first + 80]
    return ("..." if first else "") + repr(part) + ("..." if first + 80 < len(text) else "")


def _depth(expression: Expression) -> int:
    deepest, stack = 0, [(expression, 1)]
    while stack:
        current, depth = stack.pop()
        deepest = max(deepest, depth)
        stack.extend((part, depth + 1) for part in parts(current))
    return deepest


_LOGICAL = frozenset({"=>", "<=>", "|", "&", "!"})
_ORDERS = frozenset({"<", "<=", ">", ">="})


def check(expression: Expression, kinds: Mapping[str, Kind], expected: Kind) -> None:
    """Refuse unknown variables and wrong types.

    Args:
        expression: what to check.
        kinds: the variables and constants that may occur, and their types.
        expected: the type of the whole.

    Raises:
        InputError: names the variable with its column, or the operator.
    """
    found = _kind(expression, kinds)
    if found != expected:
        raise InputError(f"{render(expression)!r} is a {found}, expected a {expected}")


def _kind(expression: Expression, kinds: Mapping[str, Kind]) -> Kind:
    match expression:
        case Constant(value):
            return "bool" if isinstance(value, bool) else "number"
        case Variable(name):
            if name not in kinds:
                raise InputError(_unknown(expression, kinds))
            return kinds[name]
        case Lookup(table, index):
            _require(expression, [_kind(index, kinds)], "number")
            return table.kind
        case Operation(symbol, arguments):
            found = [_kind(argument, kinds) for argument in arguments]
            return _kind_of_operation(expression, symbol, found)


def _unknown(variable: Variable, known: Iterable[str]) -> str:
    """Return the message that a name or label means nothing."""
    is_label = variable.name.startswith('"')
    alike = [name for name in known if name.startswith('"') == is_label]
    shown = f"label {variable.name}" if is_label else f"variable {variable.name!r}"
    return f"unknown {shown} at column {variable.column}{suggestion(variable.name, alike)}"


def _kind_of_operation(expression: Operation, symbol: str, found: list[Kind]) -> Kind:
    if symbol == IN:
        _require(expression, found[:1], "number")
        _require(expression, found[1:], "locations")
        return "bool"
    if symbol == "?:":
        _require(expression, found[:1], "bool")
        _require(expression, found[2:], found[1])
        return found[1]
    if symbol in ("=", "!="):
        _require(expression, found[1:], found[0])
        return "bool"
    operands: Kind = "bool" if symbol in _LOGICAL else "number"
    _require(expression, found, operands)
    return "bool" if symbol in _LOGICAL | _ORDERS else "number"


def _require(expression: Operation | Lookup, found: Collection[Kind], expected: Kind) -> None:
    for kind in found:
        if kind != expected:
            symbol = "[]" if isinstance(expression, Lookup) else expression.operator
            symbol = "-" if symbol == "neg" else symbol
            text = _around(render(expression), 1)
            raise InputError(f"{symbol!r} in {text} needs a {expected} where there is a {kind}")
