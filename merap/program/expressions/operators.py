"""The operators of expressions on fractions and truth values.

`?:`, `&`, `|` and `=>` are not among them: only the parts that are needed are computed.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

from merap.errors import InputError

MAX_EXPONENT = 64
MAX_BITS = 1000
MAX_DENOMINATOR = 10**9  # of a root that is recognised as rational


def bounded(value: Fraction) -> Fraction:
    """The value, if it is of a size that a double can hold.

    Raises:
        InputError: it is too large or has too many digits.
    """
    if max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS:
        raise InputError(f"a number is beyond {MAX_BITS} bits")
    return value


def _divide(left: Fraction, right: Fraction) -> Fraction:
    if right == 0:
        raise InputError("division by zero")
    return left / right


def _power(base: Fraction, exponent: Fraction) -> Fraction:
    if abs(exponent) > MAX_EXPONENT:
        raise InputError(f"the exponent {exponent} is beyond {MAX_EXPONENT}")
    if exponent.denominator != 1 or (base == 0 and exponent < 0):
        raise InputError(f"pow({base}, {exponent}) is not a rational number")
    return Fraction(base ** int(exponent))


def _modulo(left: Fraction, right: Fraction) -> Fraction:
    if right == 0:
        raise InputError("mod by zero")
    return left % right


# The value of the left side that decides, whatever the right one is, and the result.
DECIDED_BY_LEFT: Mapping[str, tuple[bool, bool]] = {
    "&": (False, False),
    "|": (True, True),
    "=>": (False, True),
}

EXACT: Mapping[str, Callable[..., Any]] = {
    "<=>": operator.eq,
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
}


def _nearest_power(base: Fraction, exponent: Fraction) -> Fraction:
    """Return a power; a root that is no rational number as the nearest double."""
    if exponent.denominator == 1 or abs(exponent) > MAX_EXPONENT:
        return _power(base, exponent)
    if base < 0 or (base == 0 and exponent < 0):
        raise InputError(f"pow({base}, {exponent}) is not a real number")
    try:
        nearest = Fraction(float(base) ** float(exponent))
    except OverflowError as error:
        raise InputError(f"a number is beyond {MAX_BITS} bits") from error
    root = nearest.limit_denominator(MAX_DENOMINATOR)
    is_exact = exponent.denominator <= MAX_EXPONENT and root**exponent.denominator == base**exponent.numerator
    return root if is_exact else nearest


# The same for values that attributes decide, where roots are allowed.
NEAREST: Mapping[str, Callable[..., Any]] = {**EXACT, "pow": _nearest_power}
