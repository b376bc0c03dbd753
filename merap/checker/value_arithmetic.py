"""Compute with values that have bounds, and compare them.

Bounds are rounded outwards; each operation takes the bounds of all that its operands may be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce

import numpy as np

from merap.checker.solving import Values
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.mdp.model import Bools, Floats, Ints

Combine = Callable[[Floats, Floats], Floats]
COMPARISONS: Mapping[str, Callable[[Floats, Floats], Bools]] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "=": np.equal,
    "!=": np.not_equal,
}

LOGICAL: Mapping[str, Callable[[Bools, Bools], Bools]] = {
    "&": np.logical_and,
    "|": np.logical_or,
    "=>": lambda left, right: ~left | right,
    "<=>": np.equal,
    "=": np.equal,
    "!=": np.not_equal,
}


def _spanning(combine: Combine) -> Callable[[Values, Values], Values]:
    """Combine all ends; the operation must be monotone in each operand on its interval."""

    def applied(left: Values, right: Values) -> Values:
        with np.errstate(all="ignore"):
            ends = [
                combine(one, other)
                for one in (left.lower, left.upper)
                for other in (right.lower, right.upper)
            ]
            value = combine(left.value, right.value)
        lower = np.nextafter(np.minimum.reduce(ends), -np.inf)
        upper = np.nextafter(np.maximum.reduce(ends), np.inf)
        return Values(value, lower, upper, left.exact and right.exact)

    return applied


def _quotient(left: Values, right: Values) -> Values:
    spans_nought = (right.lower <= 0) & (right.upper >= 0)
    found = _spanning(np.divide)(left, right)
    return Values(
        found.value,
        np.where(spans_nought, np.nan, found.lower),
        np.where(spans_nought, np.nan, found.upper),
        found.exact,
    )


ARITHMETIC: Mapping[str, Callable[[Values, Values], Values]] = {
    "+": _spanning(np.add),
    "-": _spanning(np.subtract),
    "*": _spanning(np.multiply),
    "/": _quotient,
}


def negative(values: Values) -> Values:
    """Return 0 minus the values."""
    return Values(-values.value, -values.upper, -values.lower, values.exact)


def call(function: str, arguments: Sequence[Values]) -> Values:
    """Apply a function of PRISM's language.

    Raises:
        UnsupportedPropertyError: it is none of `min`, `max`, `floor`, `ceil`, `round`.
    """
    match function:
        case "min" | "max":
            chosen = np.minimum if function == "min" else np.maximum
            return reduce(
                lambda left, right: Values(
                    chosen(left.value, right.value),
                    chosen(left.lower, right.lower),
                    chosen(left.upper, right.upper),
                    left.exact and right.exact,
                ),
                arguments,
            )
        case "floor" | "ceil":
            return arguments[0].mapped(getattr(np, function))
        case "round":
            return arguments[0].mapped(lambda column: np.floor(column + 0.5))
    raise UnsupportedPropertyError(f"{function}(..) of a value that is computed is not supported")


def compared(symbol: str, left: Values, right: Values, states: Ints) -> Bools | None:
    """Return bool [S], right in the states that matter; None where bounds overlap and leave it open."""
    low, high = left.lower[states], left.upper[states]
    other_low, other_high = right.lower[states], right.upper[states]
    known = (
        (high < other_low)
        | (low > other_high)
        | ((low == high) & (other_low == other_high) & (low == other_low))
    )
    return COMPARISONS[symbol](left.value, right.value) if known.all() else None
