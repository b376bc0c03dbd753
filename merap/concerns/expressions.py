"""Expressions in PRISM's syntax: parse, check, fold, evaluate on arrays, render.

Variables are attributes (`light`), the mode (`mode`), and the same of the successor with a
prime (`light'`, `mode'`). Parameters and names of modes are constants that `fold` puts in.
Numbers are exact fractions until they are evaluated.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
from lark import Token, Transformer, UnexpectedInput, UnexpectedToken, v_args
from lark.exceptions import VisitError

from merap.concerns.expression_grammar import ARITIES, parser
from merap.concerns.expression_operators import ARRAYS, EXACT, bounded
from merap.concerns.expression_text import render, render_constant
from merap.concerns.expression_tree import (
    Constant,
    Expression,
    Kind,
    Operation,
    Value,
    Variable,
    exact,
    variables,
)
from merap.concerns.names import suggestion
from merap.errors import InputError

__all__ = [
    "Constant",
    "Expression",
    "Kind",
    "Operation",
    "Value",
    "Variable",
    "check",
    "evaluate",
    "exact",
    "fold",
    "parse",
    "render",
    "render_constant",
    "variables",
]

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
        if isinstance(current, Operation):
            stack.extend((argument, depth + 1) for argument in current.arguments)
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
        case Variable(name, column):
            if name not in kinds:
                raise InputError(f"unknown variable {name!r} at column {column}{suggestion(name, kinds)}")
            return kinds[name]
        case Operation(symbol, arguments):
            found = [_kind(argument, kinds) for argument in arguments]
            return _kind_of_operation(expression, symbol, found)


def _kind_of_operation(expression: Operation, symbol: str, found: list[Kind]) -> Kind:
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


def _require(expression: Operation, found: Collection[Kind], expected: Kind) -> None:
    for kind in found:
        if kind != expected:
            symbol = "-" if expression.operator == "neg" else expression.operator
            text = _around(render(expression), 1)
            raise InputError(f"{symbol!r} in {text} needs a {expected} where there is a {kind}")


def fold(expression: Expression, constants: Mapping[str, Value]) -> Expression:
    """Put constants in and compute every part that has no variable left, exactly.

    Raises:
        InputError: division by zero, or a power that is not rational.
    """
    if isinstance(expression, Variable):
        return Constant(constants[expression.name]) if expression.name in constants else expression
    if isinstance(expression, Constant):
        return expression
    if expression.operator == "?:":
        return _fold_choice(expression.arguments, constants)
    arguments = tuple(fold(argument, constants) for argument in expression.arguments)
    values = [argument.value for argument in arguments if isinstance(argument, Constant)]
    if len(values) < len(arguments):
        return Operation(expression.operator, arguments)
    value = EXACT[expression.operator](*values)
    return Constant(value if isinstance(value, bool) else bounded(value))


def _fold_choice(arguments: tuple[Expression, ...], constants: Mapping[str, Value]) -> Expression:
    """Fold only the side that is taken, once that is known."""
    condition = fold(arguments[0], constants)
    if isinstance(condition, Constant):
        return fold(arguments[1 if condition.value else 2], constants)
    return Operation("?:", (condition, fold(arguments[1], constants), fold(arguments[2], constants)))


def evaluate(expression: Expression, scope: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Evaluate over arrays that broadcast; bool or float64.

    Of a `?:` each side is evaluated only where it is taken.

    Raises:
        InputError: a division by zero, or a result that is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        values = _evaluate(expression, scope)
    if values.dtype != np.bool_ and not np.all(np.isfinite(values)):
        raise InputError(f"{_around(render(expression), 1)} is not a finite number for some attribute values")
    return values


def _evaluate(expression: Expression, scope: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
    match expression:
        case Constant(value):
            return np.asarray(value if isinstance(value, bool) else float(value))
        case Variable(name):
            return np.asarray(scope[name])
        case Operation("?:", (condition, taken, other)):
            return _choose(_evaluate(condition, scope), taken, other, scope)
        case Operation(symbol, arguments):
            return np.asarray(ARRAYS[symbol](*(_evaluate(argument, scope) for argument in arguments)))


def _choose(
    condition: npt.NDArray[Any], taken: Expression, other: Expression, scope: Mapping[str, npt.NDArray[Any]]
) -> npt.NDArray[Any]:
    read = {variable.name for side in (taken, other) for variable in variables(side)}
    arrays = {name: np.asarray(scope[name]) for name in read}
    shape = np.broadcast_shapes(condition.shape, *(array.shape for array in arrays.values()))
    mask = np.broadcast_to(condition, shape)
    sides = []
    for side, where in ((taken, mask), (other, ~mask)):
        part = {name: np.broadcast_to(array, shape)[where] for name, array in arrays.items()}
        sides.append((where, np.broadcast_to(_evaluate(side, part), int(np.count_nonzero(where)))))
    result = np.empty(shape, dtype=np.result_type(*(values.dtype for _, values in sides)))
    for where, values in sides:
        result[where] = values
    return result
