"""Build expressions from others, without terms that change nothing.

A later condition need not be defined where an earlier one decides.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from fractions import Fraction
from functools import reduce

from merap.program.expressions.tree import Constant, Expression, Operation

TRUE, FALSE = Constant(True), Constant(False)
ZERO, ONE = Constant(Fraction(0)), Constant(Fraction(1))


def number(value: float | Fraction) -> Constant:
    """Return a number as it is, a double not rounded."""
    return Constant(Fraction(value))


def negation(condition: Expression) -> Expression:
    """Return where a condition does not hold."""
    return Operation("!", (condition,))


def all_of(conditions: Iterable[Expression]) -> Expression:
    """Return where all of some conditions hold."""
    return _joined("&", conditions, TRUE)


def any_of(conditions: Iterable[Expression]) -> Expression:
    """Return where one of some conditions holds."""
    return _joined("|", conditions, FALSE)


def none_of(conditions: Iterable[Expression]) -> Expression:
    """Return where none of some conditions holds."""
    found = any_of(conditions)
    return TRUE if found == FALSE else negation(found)


def product_of(factors: Iterable[Expression]) -> Expression:
    """Return the product of some numbers."""
    return _of_two_each("*", [factor for factor in factors if factor != ONE], ONE)


def _joined(symbol: str, conditions: Iterable[Expression], neutral: Constant) -> Expression:
    distinct = dict.fromkeys(condition for condition in conditions if condition != neutral)
    return _of_two_each(symbol, distinct, neutral)


def _of_two_each(symbol: str, operands: Collection[Expression], neutral: Constant) -> Expression:
    """Return an operation of all operands; of none the neutral one."""
    return reduce(lambda left, right: Operation(symbol, (left, right)), operands) if operands else neutral
