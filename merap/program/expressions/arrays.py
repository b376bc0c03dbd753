"""Fractions and truth values as arrays, and the operators of expressions on them.

Numerators and denominators are 64-bit integers, or Python's integers of any size in arrays of objects,
which are some thirty times slower. A result that does not fit, or that may be undefined, is marked as not
known; its numbers mean nothing. All arrays of one value broadcast to [M].
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, reduce
from typing import Any, TypeAlias

import numpy as np

from merap.mdp.model import Bools, Ints
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions.operators import DECIDED_BY_LEFT, MAX_BITS, MAX_EXPONENT

LARGEST = 2**62


@dataclass(frozen=True, eq=False, repr=False)
class Truths(ShortRepr):
    """Truth values [M], right where `known`."""

    value: Bools
    known: Bools

    def __getitem__(self, codes: Ints) -> Truths:
        return Truths(self.value[codes], np.broadcast_to(self.known, self.value.shape)[codes])


@dataclass(frozen=True, eq=False, repr=False)
class Numbers(ShortRepr):
    """Fractions num / den [M] in lowest terms with den >= 1, right where `known`."""

    num: Ints
    den: Ints
    known: Bools

    def __getitem__(self, codes: Ints) -> Numbers:
        den = self.den[codes] if self.den.ndim else self.den
        return Numbers(self.num[codes], den, self.known[codes] if self.known.ndim else self.known)


Operand: TypeAlias = Numbers | Truths


def numbers(values: Sequence[Fraction], dtype: type[Any]) -> Numbers:
    """Return fractions as arrays [M] of `np.int64` or `object`; what is too large is not known."""
    limit = LARGEST if dtype is np.int64 else 2**MAX_BITS
    fits = [abs(value.numerator) < limit and value.denominator < limit for value in values]
    kept = [value if fit else Fraction(0) for value, fit in zip(values, fits, strict=True)]
    return Numbers(
        np.array([value.numerator for value in kept], dtype=dtype),
        np.array([value.denominator for value in kept], dtype=dtype),
        np.array(fits, dtype=np.bool_),
    )


def choose(condition: Any, taken: Any, other: Any) -> Any:
    """Return `taken` where the condition holds, else `other`; the other side may be unknown there."""
    mask = condition.value
    known = condition.known & np.where(mask, taken.known, other.known)
    if isinstance(taken, Truths):
        return Truths(np.where(mask, taken.value, other.value), known)
    return Numbers(np.where(mask, taken.num, other.num), np.where(mask, taken.den, other.den), known)


_bits = np.frompyfunc(int.bit_length, 1, 1)


def _product(left: Ints, right: Ints) -> tuple[Ints, Bools]:
    """Return the products that fit, 0 for the others, and which fit."""
    if left.dtype == np.int64:
        fits = np.abs(left.astype(np.float64)) * np.abs(right.astype(np.float64)) < LARGEST
    else:
        fits = np.asarray(_bits(left) + _bits(right), dtype=np.int64) <= MAX_BITS
    return np.where(fits, left, 0) * right, fits


def _are_small_and_whole(number: Numbers) -> bool:
    """Return whether they are 64-bit integers, by a denominator that they share; others may be whole too."""
    return number.num.dtype == np.int64 and number.den.size == 1 and bool(number.den.item() == 1)


def _lowest(num: Ints, den: Ints, known: Bools) -> Numbers:
    if den.size == 1 and den.item() == 1:
        return Numbers(num, den, known)
    divisor = np.maximum(np.gcd(num, den), 1)
    return Numbers(num // divisor, np.maximum(den // divisor, 1), known)


def _on_one_denominator(left: Numbers, right: Numbers) -> tuple[Ints, Ints, Ints, Bools]:
    """Return both numerators on the least common denominator, that, and where all of them are known."""
    if _are_small_and_whole(left) and _are_small_and_whole(right):
        fits = (np.abs(left.num) < LARGEST) & (np.abs(right.num) < LARGEST)
        return left.num, right.num, left.den, left.known & right.known & fits
    common = np.gcd(left.den, right.den)
    one, one_fits = _product(left.num, right.den // common)
    other, other_fits = _product(right.num, left.den // common)
    den, den_fits = _product(left.den, right.den // common)
    return one, other, den, left.known & right.known & one_fits & other_fits & den_fits


def _sum(left: Numbers, right: Numbers) -> Numbers:
    one, other, den, known = _on_one_denominator(left, right)
    return _lowest(one + other, den, known)


def _negative(number: Numbers) -> Numbers:
    return Numbers(-number.num, number.den, number.known)


def _difference(left: Numbers, right: Numbers) -> Numbers:
    return _sum(left, _negative(right))


def _times(left: Numbers, right: Numbers) -> Numbers:
    one, other = np.gcd(left.num, right.den), np.gcd(right.num, left.den)
    num, num_fits = _product(left.num // one, right.num // other)
    den, den_fits = _product(left.den // other, right.den // one)
    return _lowest(num, den, left.known & right.known & num_fits & den_fits)


def _inverse(number: Numbers) -> Numbers:
    """Return 1 / number; not known where it is 0."""
    num = np.sign(number.num) * number.den
    return Numbers(num, np.maximum(np.abs(number.num), 1), number.known & (number.num != 0))


def _quotient(left: Numbers, right: Numbers) -> Numbers:
    return _times(left, _inverse(right))


def _floor(number: Numbers) -> Numbers:
    num = number.num // number.den
    return Numbers(num, np.ones_like(num), number.known)


def _ceil(number: Numbers) -> Numbers:
    return _negative(_floor(_negative(number)))


def _modulo(left: Numbers, right: Numbers) -> Numbers:
    return _difference(left, _times(right, _floor(_quotient(left, right))))


def _power(base: Numbers, exponent: Numbers) -> Numbers:
    """Return the power to one whole exponent; others are not known."""
    first = int(exponent.num.flat[0]) if exponent.num.size else 0
    if abs(first) > MAX_EXPONENT or np.any(exponent.num != first) or np.any(exponent.den != 1):
        return Numbers(base.num, base.den, np.zeros_like(base.known))
    power = reduce(_times, [base] * abs(first), numbers([Fraction(1)], base.num.dtype.type))
    power = _inverse(power) if first < 0 else power
    return Numbers(power.num, power.den, power.known & exponent.known)


def _compared(holds: Callable[[Ints, Ints], Bools], left: Numbers, right: Numbers) -> Truths:
    one, other, _, known = _on_one_denominator(left, right)
    return Truths(holds(one, other), known)


def _extreme(keeps: Callable[[Ints, Ints], Bools], left: Numbers, right: Numbers) -> Numbers:
    chosen: Numbers = choose(_compared(keeps, left, right), left, right)
    return chosen


def _equal(equal: Callable[[Any, Any], Bools], left: Any, right: Any) -> Truths:
    if isinstance(left, Numbers):
        return _compared(equal, left, right)
    return Truths(equal(left.value, right.value), left.known & right.known)


def _logical(symbol: str, left: Truths, right: Truths) -> Truths:
    """Decide from the left: where the left side does, the right one may be unknown."""
    deciding, result = DECIDED_BY_LEFT[symbol]
    decided = left.value == deciding
    return Truths(np.where(decided, result, right.value), left.known & (decided | right.known))


FUNCTIONS: Mapping[str, Callable[..., Operand]] = {
    "=>": partial(_logical, "=>"),
    "<=>": partial(_equal, np.equal),
    "|": partial(_logical, "|"),
    "&": partial(_logical, "&"),
    "!": lambda truth: Truths(np.logical_not(truth.value), truth.known),
    "=": partial(_equal, np.equal),
    "!=": partial(_equal, np.not_equal),
    "<": partial(_compared, np.less),
    "<=": partial(_compared, np.less_equal),
    ">": partial(_compared, np.greater),
    ">=": partial(_compared, np.greater_equal),
    "+": _sum,
    "-": _difference,
    "*": _times,
    "/": _quotient,
    "neg": _negative,
    "min": lambda *parts: reduce(partial(_extreme, np.less_equal), parts),
    "max": lambda *parts: reduce(partial(_extreme, np.greater_equal), parts),
    "floor": _floor,
    "ceil": _ceil,
    "pow": _power,
    "mod": _modulo,
}
