"""Decide which expressions an engine computes right, although it computes in doubles.

Storm and PRISM-games decide comparisons on rounded numbers, even where they compute with fractions
otherwise: `x + 1/5 <= 3/10` is false at x = 1/10. And Storm takes numbers for equal that differ by
less than some 1e-10 of their size.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

import numpy as np

from merap.program.expressions import Constant, Expression, Levels, Operation, Variable

MAX_INTEGER = 2**31 - 1  # of PRISM-games
# Sums and products of decimals up to here are wrong by less than 1e-11.
MODERATE = 10_000
# Different numbers whose difference is a larger part of their size are not taken for equal.
APART = 1e-9
COMPARISONS = frozenset({"=", "!=", "<", "<=", ">", ">="})
_TRUTHS = COMPARISONS | {"=>", "<=>", "|", "&", "!"}

# The values of a variable.
LevelsOf: TypeAlias = Callable[[str], Levels]


def is_truth(expression: Expression, levels: LevelsOf) -> bool:
    """Return whether the value is true or false, not a number."""
    match expression:
        case Constant(value):
            return isinstance(value, bool)
        case Variable(name):
            return isinstance(levels(name).values[0], bool)
        case Operation("?:", arguments):
            return is_truth(arguments[1], levels)
        case Operation(symbol, _):
            return symbol in _TRUTHS


def is_computed_right(expression: Expression, levels: LevelsOf) -> bool:
    """Return whether engines get the number right but for an error that does not matter.

    The conditions of `?:` are left out of account.
    """
    return not isinstance(expression, Operation) or _range(expression, levels) is not None


def is_decided_right(comparison: Operation, levels: LevelsOf) -> bool:
    """Return whether engines decide a comparison of numbers as fractions would.

    They do between whole numbers, and where each side is a number that is rounded only once, unless
    two different numbers are so near to each other that they may be taken for equal.
    """
    rounded: set[Fraction] = set()
    for side in comparison.arguments:
        if isinstance(side, Operation):
            found = _range(side, levels)
            if found is None or not found.whole:
                return False
        else:
            rounded |= set(map(Fraction, _levels(side, levels).values))
    return are_apart(rounded)


def are_apart(numbers: Collection[Fraction]) -> bool:
    """Return whether different numbers, and whole ones beside them, can't be taken for equal."""
    values = np.array([float(number) for number in {*numbers, *map(round, numbers)}])
    values.sort()
    return bool(np.all(np.diff(values) > APART * np.maximum(1, np.abs(values[1:]))))


@dataclass(frozen=True)
class _Range:
    """A bound on the size of values, and whether all are whole."""

    whole: bool
    most: Fraction

    def trusted(self) -> _Range | None:
        return self if self.most <= (MAX_INTEGER if self.whole else MODERATE) else None


def _levels(leaf: Constant | Variable, levels: LevelsOf) -> Levels:
    return Levels((leaf.value,)) if isinstance(leaf, Constant) else levels(leaf.name)


def _range(expression: Expression, levels: LevelsOf) -> _Range | None:
    """Return the range of a number; None where engines are not to be trusted with it."""
    if not isinstance(expression, Operation):
        found = _levels(expression, levels)
        return _Range(found.are_whole, found.most).trusted()
    symbol, arguments = expression.operator, expression.arguments
    if symbol in ("floor", "ceil"):
        return _range_of_whole_part(arguments[0], levels)
    parts = [_range(argument, levels) for argument in (arguments[1:] if symbol == "?:" else arguments)]
    ranges = [part for part in parts if part is not None]
    if len(ranges) < len(parts):
        return None
    combined = _combined(symbol, arguments, ranges)
    return None if combined is None else combined.trusted()


def _combined(symbol: str, arguments: tuple[Expression, ...], ranges: list[_Range]) -> _Range | None:
    whole, sizes = all(part.whole for part in ranges), [part.most for part in ranges]
    if symbol in ("+", "-"):
        return _Range(whole, sum(sizes, Fraction(0)))
    if symbol == "*":
        return _Range(whole, sizes[0] * sizes[1])
    if symbol in ("neg", "min", "max", "?:"):
        return _Range(whole, max(sizes))
    if symbol == "/" and isinstance(arguments[1], Constant) and arguments[1].value != 0:
        return _Range(False, sizes[0] / sizes[1])
    return None


def _range_of_whole_part(argument: Expression, levels: LevelsOf) -> _Range | None:
    """`floor` and `ceil` of a whole number, of a quotient of whole numbers, or of what is rounded once."""
    found = _range(argument, levels)
    if found is None:
        return None
    if isinstance(argument, Operation):
        is_quotient = argument.operator == "/" and all(
            part is not None and part.whole for part in (_range(side, levels) for side in argument.arguments)
        )
        if not (found.whole or is_quotient):
            return None
    elif not are_apart(set(map(Fraction, _levels(argument, levels).values))):
        return None
    return _Range(True, found.most + 1).trusted()
