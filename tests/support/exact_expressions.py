"""Random expressions with their meaning in plain Python: fractions, one value at a time.

Nothing of merap is used here, so that it is a third route beside exploration and PRISM text.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from hypothesis import strategies as st

Surroundings = Mapping[str, Any]


@dataclass(frozen=True)
class Sample:
    """An expression's text and what it is where the variables have given values."""

    text: str
    value: Callable[[Surroundings], Any]


def _constant(text: str) -> Sample:
    value = Fraction(text)
    return Sample(text if value >= 0 else f"({text})", lambda _: value)


def _variable(name: str) -> Sample:
    return Sample(name, lambda known: known[name])


def _applied(text: str, function: Callable[..., Any], *parts: Sample) -> Sample:
    return Sample(
        text.format(*(part.text for part in parts)),
        lambda known: function(*(part.value(known) for part in parts)),
    )


NUMERIC: dict[str, Callable[..., Any]] = {
    "({} + {})": lambda a, b: a + b,
    "({} - {})": lambda a, b: a - b,
    "({} * {})": lambda a, b: a * b,
    "min({}, {})": min,
    "max({}, {})": max,
    "(-{})": lambda a: -a,
    "floor({})": lambda a: Fraction(math.floor(a)),
    "ceil({})": lambda a: Fraction(math.ceil(a)),
    "({} / 0.3)": lambda a: a / Fraction(3, 10),
    "({} / -7)": lambda a: a / -7,
    "mod({}, 0.3)": lambda a: a - Fraction(3, 10) * math.floor(a / Fraction(3, 10)),
    "mod({}, -2)": lambda a: a + 2 * math.floor(a / -2),
    "pow({}, 2)": lambda a: a**2,
    "({0} = 0 ? 0 : pow({0}, -1))": lambda a: a if a == 0 else 1 / a,
    "({0} = 0 ? 1 : 0.3 / {0})": lambda a: Fraction(1) if a == 0 else Fraction(3, 10) / a,
}
ORDERS: dict[str, Callable[..., Any]] = {
    "({} < {})": lambda a, b: a < b,
    "({} <= {})": lambda a, b: a <= b,
    "({} > {})": lambda a, b: a > b,
    "({} >= {})": lambda a, b: a >= b,
    "({} = {})": lambda a, b: a == b,
    "({} != {})": lambda a, b: a != b,
}
LOGICAL: dict[str, Callable[..., Any]] = {
    "({} & {})": lambda a, b: a and b,
    "({} | {})": lambda a, b: a or b,
    "({} => {})": lambda a, b: not a or b,
    "({} <=> {})": lambda a, b: a == b,
    "(!{})": lambda a: not a,
}
CONSTANTS = ("0.1", "0.2", "0.3", "0.7", "1", "2", "-3", "9007199254740993", "123456789.123456789")


def _operations(table: dict[str, Callable[..., Any]], part: st.SearchStrategy[Sample]) -> Any:
    def built(text: str) -> st.SearchStrategy[Sample]:
        count = 1 if "{0}" in text else text.count("{}")
        return st.builds(_applied, st.just(text), st.just(table[text]), *[part] * count)

    return st.sampled_from(list(table)).flatmap(built)


def numbers(depth: int, names: tuple[str, ...], truths_of: tuple[str, ...] = ()) -> st.SearchStrategy[Sample]:
    """Numbers over the variables `names`, with conditions that may read `truths_of` too."""
    leaves = st.sampled_from([*map(_variable, names), *map(_constant, CONSTANTS)])
    if depth == 0:
        return leaves
    inner = numbers(depth - 1, names, truths_of)
    condition = truths(depth - 1, names, truths_of)
    choice = st.builds(
        _applied,
        st.just("({} ? {} : {})"),
        st.just(lambda c, a, b: a if c else b),
        condition,
        inner,
        inner,
    )
    return st.one_of(leaves, _operations(NUMERIC, inner), choice)


def truths(depth: int, names: tuple[str, ...], truths_of: tuple[str, ...] = ()) -> st.SearchStrategy[Sample]:
    """Truth values over the numbers `names` and the truth values `truths_of`."""
    compared = _operations(ORDERS, numbers(max(0, depth - 1), names, truths_of))
    leaves = st.one_of(compared, st.sampled_from([*map(_variable, truths_of)])) if truths_of else compared
    if depth == 0:
        return leaves
    return st.one_of(leaves, compared, _operations(LOGICAL, truths(depth - 1, names, truths_of)))
