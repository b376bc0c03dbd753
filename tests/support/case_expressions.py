"""Expressions of a case file in plain Python and fractions, by the words of the language alone.

An expression becomes a function of a scope; the scope knows what names, places and labels mean.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any, Protocol

TOKEN = re.compile(
    r"""\s*(?:(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)|("[^"]*")|((?:\w+\.)?[A-Za-z_]\w*'?)|(<=>|=>|<=|>=|!=|.))"""
)
# from loosest to tightest; `!` stands between & and =
LEVELS = (
    ("=>",),
    ("<=>",),
    ("|",),
    ("&",),
    ("!",),
    ("=", "!="),
    ("<", "<=", ">", ">="),
    ("+", "-"),
    ("*", "/"),
)
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "min": min,
    "max": max,
    "floor": math.floor,
    "ceil": math.ceil,
    "pow": lambda base, exponent: base**exponent,
    "mod": lambda left, right: left - right * math.floor(Fraction(left) / right),
}
OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "<=>": lambda left, right: left == right,
    "=": lambda left, right: left == right,
    "!=": lambda left, right: left != right,
    "<": lambda left, right: left < right,
    "<=": lambda left, right: left <= right,
    ">": lambda left, right: left > right,
    ">=": lambda left, right: left >= right,
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
    "/": lambda left, right: Fraction(left) / right,
}


class Meanings(Protocol):
    """What an expression reads."""

    def value(self, name: str) -> Any:
        """The value of a name, which may end in a prime."""

    def holds(self, label: str) -> bool:
        """Whether a label holds."""

    def is_at(self, places: Any, *, after: bool) -> bool:
        """Whether the location, before or after the step, is one of some places."""


Reader = Callable[[Meanings], Any]


def number(value: Any) -> Any:
    """A number of the file as it is written; what is none stays."""
    return Fraction(str(value)) if isinstance(value, int | float) and not isinstance(value, bool) else value


@cache
def _parsed(text: str) -> Reader:
    parser = _Parser([match.groups() for match in TOKEN.finditer(text.strip())])
    reader = parser.ternary()
    assert not parser.tokens, f"{text}: {parser.tokens} left over"
    return reader


def evaluate(expression: Any, scope: Meanings) -> Any:
    """The value of what stands in a case file where an expression may."""
    return _parsed(expression)(scope) if isinstance(expression, str) else number(expression)


class _Parser:
    """Recursive descent over (number, label, name, symbol) tuples."""

    def __init__(self, tokens: list[tuple[str, ...]]) -> None:
        self.tokens = tokens

    def next(self) -> tuple[str, ...]:
        return self.tokens.pop(0)

    def accept(self, *symbols: str) -> str | None:
        if self.tokens and self.tokens[0][3] in symbols:
            return self.next()[3]
        return None

    def expect(self, symbol: str) -> None:
        assert self.accept(symbol), f"expected {symbol} before {self.tokens}"

    def ternary(self) -> Reader:
        condition = self.binary(0)
        if not self.accept("?"):
            return condition
        taken = self.ternary()
        self.expect(":")
        other = self.ternary()
        return lambda scope: taken(scope) if condition(scope) else other(scope)

    def binary(self, level: int) -> Reader:
        if level == len(LEVELS):
            return self.unary()
        if LEVELS[level] == ("!",):
            if self.accept("!"):
                negated = self.binary(level)
                return lambda scope: not negated(scope)
            return self.binary(level + 1)
        left = self.binary(level + 1)
        while symbol := self.accept(*LEVELS[level]):
            left = _joined(symbol, left, self.binary(level if symbol == "=>" else level + 1))
        return left

    def unary(self) -> Reader:
        if self.accept("-"):
            negative = self.unary()
            return lambda scope: -negative(scope)
        if self.accept("("):
            inner = self.ternary()
            self.expect(")")
            return inner
        return self.atom(*self.next())

    def atom(self, digits: str, label: str, name: str, symbol: str) -> Reader:
        if digits:
            constant = Fraction(digits)
            return lambda _: constant
        if label:
            return lambda scope: scope.holds(label[1:-1])
        assert name, f"{symbol} where a value is expected"
        if not self.accept("("):
            return _name(name)
        if name in ("at", "at'"):
            places = self.places()
            self.expect(")")
            return lambda scope: scope.is_at(places, after=name == "at'")
        arguments = [self.ternary()]
        while self.accept(","):
            arguments.append(self.ternary())
        self.expect(")")
        return lambda scope: FUNCTIONS[name](*(argument(scope) for argument in arguments))

    def places(self) -> Any:
        if not self.accept("["):
            digits, _, name, _ = self.next()
            return int(digits) if digits else name
        items = [self.places()]
        while self.accept(","):
            items.append(self.places())
        self.expect("]")
        return items


def _name(name: str) -> Reader:
    if name in ("true", "false"):
        return lambda _: name == "true"
    return lambda scope: scope.value(name)


def _joined(symbol: str, left: Reader, right: Reader) -> Reader:
    if symbol == "&":
        return lambda scope: left(scope) and right(scope)
    if symbol == "|":
        return lambda scope: left(scope) or right(scope)
    if symbol == "=>":
        return lambda scope: not left(scope) or right(scope)
    operate = OPERATORS[symbol]
    return lambda scope: operate(left(scope), right(scope))
