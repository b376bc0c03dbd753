"""Expressions in PRISM's syntax: parse, check, fold, evaluate on arrays, render.

Variables are attributes (`light`), the mode (`mode`), and the same of the successor with a
prime (`light'`, `mode'`). Parameters and names of modes are constants that `fold` puts in.
Numbers are exact fractions until they are evaluated.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, reduce
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from lark import Lark, Token, Transformer, UnexpectedInput, v_args
from lark.exceptions import VisitError

from merap.errors import InputError

Kind: TypeAlias = Literal["bool", "number"]
Value: TypeAlias = Fraction | bool
MAX_LENGTH = 10_000
MAX_EXPONENT = 64


@dataclass(frozen=True)
class Constant:
    """A number or a truth value."""

    value: Value


@dataclass(frozen=True)
class Variable:
    """A name, with its prime if it speaks of the successor; `column` counts from 1."""

    name: str
    column: int


@dataclass(frozen=True)
class Operation:
    """An operator or function and its arguments."""

    operator: str
    arguments: tuple[Expression, ...]


Expression: TypeAlias = Constant | Variable | Operation

GRAMMAR = r"""
?start: conditional
?conditional: implication | implication "?" conditional ":" conditional -> choose
?implication: equivalence | equivalence IMPLIES implication -> binary
?equivalence: disjunction | equivalence IFF disjunction -> binary
?disjunction: conjunction | disjunction OR conjunction -> binary
?conjunction: negation | conjunction AND negation -> binary
?negation: equality | NOT negation -> unary
?equality: relation | equality EQUALS relation -> binary
?relation: sum | relation ORDER sum -> binary
?sum: product | sum ADD product -> binary
?product: minus | product TIMES minus -> binary
?minus: atom | "-" minus -> negate
?atom: NUMBER -> number | "true" -> true | "false" -> false | NAME -> variable
     | FUNCTION "(" conditional ("," conditional)* ")" -> call | "(" conditional ")"
IMPLIES: "=>"
IFF: "<=>"
OR: "|"
AND: "&"
NOT: "!"
EQUALS: "=" | "!="
ORDER: "<=" | ">=" | "<" | ">"
ADD: "+" | "-"
TIMES: "*" | "/"
FUNCTION.2: /(min|max|floor|ceil|pow|mod)(?=\s*\()/
NAME: /[A-Za-z_][A-Za-z0-9_]*'?/
NUMBER: /\d+(\.\d+)?([eE][+-]?\d{1,3})?/
%ignore /[ \t\r\n]+/
"""

ARITIES: Mapping[str, range] = {
    "min": range(2, 100),
    "max": range(2, 100),
    "floor": range(1, 2),
    "ceil": range(1, 2),
    "pow": range(2, 3),
    "mod": range(2, 3),
}


@v_args(inline=True)
class _Builder(Transformer[Token, Expression]):
    def number(self, token: Token) -> Expression:
        return Constant(Fraction(str(token)))

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
            raise InputError(
                f"{function} at column {function.column} takes {allowed.start} argument(s), got {len(arguments)}"
            )
        return Operation(str(function), arguments)


@lru_cache(maxsize=1)
def _parser() -> Lark:
    return Lark(GRAMMAR, parser="lalr", maybe_placeholders=False)


def parse(text: str) -> Expression:
    """Parse `text`.

    Raises:
        InputError: a syntax error, with its column.
    """
    if len(text) > MAX_LENGTH:
        raise InputError(f"an expression has {len(text)} characters, at most {MAX_LENGTH} are allowed")
    try:
        return _Builder().transform(_parser().parse(text))
    except UnexpectedInput as error:
        column = error.column if error.column > 0 else len(text) + 1
        raise InputError(f"syntax error at column {column} of {text!r}") from error
    except VisitError as error:
        if isinstance(error.orig_exc, InputError):
            raise InputError(f"{error.orig_exc.message} in {text!r}") from error
        raise
    except RecursionError as error:
        raise InputError(f"the expression is nested too deeply: {text[:40]!r}...") from error


def variables(expression: Expression) -> Iterator[Variable]:
    """Every occurrence of a variable, left to right."""
    if isinstance(expression, Variable):
        yield expression
    elif isinstance(expression, Operation):
        for argument in expression.arguments:
            yield from variables(argument)


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
                known = ", ".join(sorted(kinds)) or "none"
                raise InputError(f"unknown variable {name!r} at column {column}; allowed: {known}")
            return kinds[name]
        case Operation(symbol, arguments):
            return _kind_of_operation(symbol, [_kind(argument, kinds) for argument in arguments])


def _kind_of_operation(symbol: str, found: list[Kind]) -> Kind:
    if symbol == "?:":
        _require(symbol, found[:1], "bool")
        _require(symbol, found[2:], found[1])
        return found[1]
    if symbol in ("=", "!="):
        _require(symbol, found[1:], found[0])
        return "bool"
    operands: Kind = "bool" if symbol in _LOGICAL else "number"
    _require(symbol, found, operands)
    return "bool" if symbol in _LOGICAL | _ORDERS else "number"


def _require(symbol: str, found: Collection[Kind], expected: Kind) -> None:
    if any(kind != expected for kind in found):
        raise InputError(f"operator {symbol!r} needs a {expected} where it has another type")


def _divide(left: Any, right: Any) -> Any:
    if not isinstance(right, np.ndarray) and right == 0:
        raise InputError("division by zero")
    if isinstance(right, np.ndarray) and np.any(right == 0):
        raise InputError("division by zero for some attribute values")
    return left / right


def _power(base: Any, exponent: Any) -> Any:
    if np.any(np.abs(np.asarray(exponent, dtype=np.float64)) > MAX_EXPONENT):
        raise InputError(f"an exponent is above {MAX_EXPONENT}")
    if isinstance(base, Fraction) and isinstance(exponent, Fraction):
        if exponent.denominator != 1 or (base == 0 and exponent < 0):
            raise InputError(f"pow({base}, {exponent}) is not a rational number")
        return base ** int(exponent)
    return np.power(np.asarray(base, dtype=np.float64), np.asarray(exponent, dtype=np.float64))


def _modulo(left: Any, right: Any) -> Any:
    if np.any(np.asarray(right, dtype=np.float64) == 0):
        raise InputError("mod by zero")
    return left % right


_EXACT: Mapping[str, Callable[..., Any]] = {
    "=>": lambda a, b: not a or b,
    "<=>": operator.eq,
    "|": lambda a, b: a or b,
    "&": lambda a, b: a and b,
    "!": operator.not_,
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": _divide,
    "neg": operator.neg,
    "min": min,
    "max": max,
    "floor": lambda a: Fraction(a.__floor__()),
    "ceil": lambda a: Fraction(a.__ceil__()),
    "pow": _power,
    "mod": _modulo,
    "?:": lambda c, a, b: a if c else b,
}

_ARRAYS: Mapping[str, Callable[..., Any]] = {
    **_EXACT,
    "=>": lambda a, b: np.logical_or(np.logical_not(a), b),
    "|": np.logical_or,
    "&": np.logical_and,
    "!": np.logical_not,
    "min": lambda *a: reduce(np.minimum, a),
    "max": lambda *a: reduce(np.maximum, a),
    "floor": np.floor,
    "ceil": np.ceil,
    "?:": np.where,
}


def fold(expression: Expression, constants: Mapping[str, Value]) -> Expression:
    """Put constants in and compute every part that has no variable left, exactly.

    Raises:
        InputError: division by zero, or a power that is not rational.
    """
    if isinstance(expression, Variable):
        return Constant(constants[expression.name]) if expression.name in constants else expression
    if isinstance(expression, Constant):
        return expression
    arguments = tuple(fold(argument, constants) for argument in expression.arguments)
    if expression.operator == "?:" and isinstance(arguments[0], Constant):
        return arguments[1] if arguments[0].value else arguments[2]
    if all(isinstance(argument, Constant) for argument in arguments):
        values = [argument.value for argument in arguments if isinstance(argument, Constant)]
        return Constant(_EXACT[expression.operator](*values))
    return Operation(expression.operator, arguments)


def evaluate(expression: Expression, scope: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Evaluate over arrays that broadcast; bool or float64.

    Only the branch of a `?:` that is taken may divide by zero or not: both are computed.
    """
    match expression:
        case Constant(value):
            return np.asarray(value if isinstance(value, bool) else float(value))
        case Variable(name):
            return scope[name]
        case Operation(symbol, arguments):
            return np.asarray(_ARRAYS[symbol](*(evaluate(argument, scope) for argument in arguments)))


_LEVELS = (
    ("?:",),
    ("=>",),
    ("<=>",),
    ("|",),
    ("&",),
    ("!",),
    ("=", "!="),
    tuple(_ORDERS),
    ("+", "-"),
    ("*", "/"),
)
_PRECEDENCE = {symbol: level for level, symbols in enumerate(_LEVELS) for symbol in symbols}
_UNARY = len(_LEVELS)
_ATOM = _UNARY + 1


def render(expression: Expression, rename: Callable[[str], str] = str) -> str:
    """PRISM text with no more parentheses than needed; `rename` maps variables."""
    return _render(expression, rename)[0]


def render_constant(value: Value) -> str:
    """`true`, `3`, `-1/2`: numbers as exact fractions."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def _render(expression: Expression, rename: Callable[[str], str]) -> tuple[str, int]:
    match expression:
        case Constant(value):
            return render_constant(value), _constant_level(value)
        case Variable(name):
            return rename(name), _ATOM
        case Operation("?:", arguments):
            condition, first, second = (_wrapped(argument, rename, 1) for argument in arguments)
            return f"{condition} ? {first} : {second}", 0
        case Operation(symbol, (only,)) if symbol in ("!", "neg"):
            return ("!" if symbol == "!" else "-") + _wrapped(only, rename, _ATOM), _UNARY
        case Operation(symbol, (left, right)) if symbol in _PRECEDENCE:
            level = _PRECEDENCE[symbol]
            return f"{_wrapped(left, rename, level)} {symbol} {_wrapped(right, rename, level + 1)}", level
        case Operation(symbol, arguments):
            inner = ", ".join(_render(argument, rename)[0] for argument in arguments)
            return f"{symbol}({inner})", _ATOM


def _constant_level(value: Value) -> int:
    if isinstance(value, bool) or (value >= 0 and value.denominator == 1):
        return _ATOM
    return _PRECEDENCE["*"] if value >= 0 else _PRECEDENCE["+"]


def _wrapped(expression: Expression, rename: Callable[[str], str], level: int) -> str:
    text, own = _render(expression, rename)
    return text if own >= level else f"({text})"


def exact(number: float) -> Fraction:
    """The fraction a decimal stands for: 0.8 is 4/5, not the nearest double."""
    return Fraction(repr(number)) if isinstance(number, float) else Fraction(number)
