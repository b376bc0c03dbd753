"""Expressions as PRISM text."""

from __future__ import annotations

from collections.abc import Callable

from merap.program.expressions.columns import Value
from merap.program.expressions.tree import Constant, Expression, Lookup, Operation, Variable

MAX_INTEGER = 2**31 - 1  # of PRISM-games; Storm reads 63 bits

_LEVELS = (
    ("?:",),
    ("=>",),
    ("|",),
    ("&",),
    ("!",),
    ("=", "!=", "<=>"),
    ("<", "<=", ">", ">="),
    ("+", "-"),
    ("*", "/"),
    ("neg",),
)
_PRECEDENCE = {symbol: level for level, symbols in enumerate(_LEVELS) for symbol in symbols}
_ATOM = len(_LEVELS)
# Storm can't read <=>; on truth values = means the same.
_SIGNS = {"neg": "-", "<=>": "="}


def render(expression: Expression, rename: Callable[[str], str] = str) -> str:
    """PRISM text with no more parentheses than needed; `rename` maps variables.

    PRISM knows no `table[index]`: text for engines needs another expression in place of a lookup.
    """
    return _render(expression, rename)[0]


def render_constant(value: Value) -> str:
    """`true`, `3`, `-1/2`: numbers as exact fractions, as decimals where engines can't read that."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if max(abs(value.numerator), value.denominator) > MAX_INTEGER:
        return repr(float(value))
    return str(value)


def _render(expression: Expression, rename: Callable[[str], str]) -> tuple[str, int]:
    """The text and how tightly it binds."""
    match expression:
        case Constant(value):
            return render_constant(value), _constant_level(value)
        case Variable(name):
            return rename(name), _ATOM
        case Lookup(table, index):
            return table.meaning or f"{table.name}[{_render(index, rename)[0]}]", _ATOM
        case Operation("?:", arguments):
            condition, first = (_wrapped(argument, rename, 1) for argument in arguments[:2])
            second = _render(arguments[2], rename)[0]
            return f"{condition} ? {first} : {second}", 0
        case Operation(symbol, arguments) if symbol in _PRECEDENCE:
            return _render_operator(symbol, arguments, rename), _PRECEDENCE[symbol]
        case Operation(function, arguments):
            inner = ", ".join(_render(argument, rename)[0] for argument in arguments)
            return f"{function}({inner})", _ATOM


def _render_operator(symbol: str, arguments: tuple[Expression, ...], rename: Callable[[str], str]) -> str:
    sign = _SIGNS.get(symbol, symbol)
    if len(arguments) == 1:
        return sign + _wrapped(arguments[0], rename, _ATOM)
    level = _PRECEDENCE[symbol]
    # Engines do not agree on how a chain of => groups, so it gets parentheses.
    left = _wrapped(arguments[0], rename, level + 1 if symbol == "=>" else level)
    return f"{left} {sign} {_wrapped(arguments[1], rename, level + 1)}"


def _constant_level(value: Value) -> int:
    if isinstance(value, bool) or (value >= 0 and value.denominator == 1):
        return _ATOM
    return _PRECEDENCE["*"] if value >= 0 else _PRECEDENCE["+"]


def _wrapped(expression: Expression, rename: Callable[[str], str], level: int) -> str:
    text, own = _render(expression, rename)
    return text if own >= level else f"({text})"
