"""What the operators of expressions do, exactly on fractions and on whole arrays.

`?:` is not here: only the side that is taken is computed.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.errors import InputError

MAX_EXPONENT = 64
MAX_BITS = 1000


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


EXACT: Mapping[str, Callable[..., Any]] = {
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
}


def _divide_arrays(left: npt.NDArray[Any], right: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if np.any(right == 0):
        raise InputError("division by zero for some attribute values")
    return np.asarray(left / right)


def _power_arrays(base: npt.NDArray[Any], exponent: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if np.any(np.abs(exponent) > MAX_EXPONENT):
        raise InputError(f"an exponent is beyond {MAX_EXPONENT} for some attribute values")
    return np.asarray(np.power(base.astype(np.float64), exponent.astype(np.float64)))


def _modulo_arrays(left: npt.NDArray[Any], right: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if np.any(right == 0):
        raise InputError("mod by zero for some attribute values")
    return np.asarray(left % right)


ARRAYS: Mapping[str, Callable[..., Any]] = {
    **EXACT,
    "=>": lambda a, b: np.logical_or(np.logical_not(a), b),
    "|": np.logical_or,
    "&": np.logical_and,
    "!": np.logical_not,
    "/": _divide_arrays,
    "min": lambda *a: reduce(np.minimum, a),
    "max": lambda *a: reduce(np.maximum, a),
    "floor": np.floor,
    "ceil": np.ceil,
    "pow": _power_arrays,
    "mod": _modulo_arrays,
}
