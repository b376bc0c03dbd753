"""Columns of values, and the distinct combinations that occur in them.

Axes: B steps, L levels of a column, M distinct combinations of levels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from merap.mdp.model import Ints
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions.arrays import LARGEST, Numbers, Truths, numbers

Value: TypeAlias = Fraction | bool
# Below that many integers between the least and the greatest, each is a level, and nothing is sorted.
DENSE = 4096


def exact(number: float) -> Fraction:
    """Return the fraction that a decimal stands for: 0.8 is 4/5, not the nearest double."""
    return Fraction(repr(number)) if isinstance(number, float) else Fraction(number)


@dataclass(frozen=True, eq=False, repr=False)
class Levels(ShortRepr):
    """The distinct values of a variable, at least one."""

    values: tuple[Value, ...]

    @cached_property
    def small(self) -> Numbers | Truths:
        """[L]: the same as arrays of 64-bit integers or truth values."""
        return self._arrays(np.int64)

    @cached_property
    def big(self) -> Numbers | Truths:
        """[L]: the same as arrays of Python's integers or of truth values."""
        return self._arrays(object)

    def _arrays(self, dtype: type[Any]) -> Numbers | Truths:
        if isinstance(self.values[0], bool):
            return Truths(np.array(self.values, dtype=np.bool_), np.array(True))
        return numbers([Fraction(value) for value in self.values], dtype)

    @property
    def size(self) -> int:
        """L."""
        return len(self.values)

    @cached_property
    def are_whole(self) -> bool:
        """Whether all values are whole numbers."""
        return all(value.denominator == 1 for value in self.values)


class Integers(Levels):
    """Distinct whole numbers, of which fractions are made only where they are asked for.

    Attributes:
        array: int64 [L].
    """

    array: Ints

    def __init__(self, array: Ints) -> None:
        object.__setattr__(self, "array", array)

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """As fractions."""
        return tuple(map(Fraction, self.array.tolist()))

    @cached_property
    def small(self) -> Numbers | Truths:
        """[L]: the same as arrays of 64-bit integers."""
        fits = (self.array > -LARGEST) & (self.array < LARGEST)
        return Numbers(self.array, np.array(1), np.array(True) if fits.all() else fits)

    @property
    def size(self) -> int:
        """L."""
        return len(self.array)


@dataclass(frozen=True, eq=False, repr=False)
class Column(ShortRepr):
    """The values of a variable in B steps.

    Attributes:
        levels: its L distinct values.
        codes: int64 [B], which of them it has.
    """

    levels: Levels
    codes: Ints

    def __getitem__(self, rows: npt.NDArray[Any]) -> Column:
        """Return the values in some of the steps: a mask, or their indices."""
        return Column(self.levels, self.codes[rows])

    @staticmethod
    def of(array: npt.NDArray[Any]) -> Column:
        """Return truth values, integers or doubles as a column; a double counts as its shortest decimal."""
        array = np.asarray(array)
        if array.dtype == np.bool_:
            return Column(_TRUTHS, array.astype(np.int64))
        if array.size == 0:
            return Column(_NOUGHT, array.astype(np.int64))
        if array.dtype.kind in "iu":
            least, greatest = int(array.min()), int(array.max())
            if greatest - least < DENSE:
                return Column(Integers(np.arange(least, greatest + 1)), array.astype(np.int64) - least)
        distinct, codes = np.unique(array, return_inverse=True)
        if np.can_cast(array.dtype, np.int64):
            return Column(Integers(distinct.astype(np.int64)), codes.reshape(array.shape))
        return Column(Levels(tuple(map(exact, distinct.tolist()))), codes.reshape(array.shape))


_TRUTHS, _NOUGHT = Levels((False, True)), Levels((Fraction(0),))
Scope: TypeAlias = Mapping[str, Column | npt.NDArray[Any]]


@dataclass(frozen=True, eq=False, repr=False)
class Combinations(ShortRepr):
    """The distinct combinations of values in some columns.

    Attributes:
        shape: of the columns, broadcast.
        inverse: int64 [B], which combination a step has.
        count: M.
        read: name -> the levels of its column, and int64 [M], which of them a combination has.
    """

    shape: tuple[int, ...]
    inverse: Ints
    count: int
    read: Mapping[str, tuple[Levels, Ints]]

    @staticmethod
    def of(names: Sequence[str], scope: Scope) -> Combinations:
        """Return those of the columns with some names."""
        columns = [
            column if isinstance(column := scope[name], Column) else Column.of(column) for name in names
        ]
        shape = np.broadcast_shapes(*(column.codes.shape for column in columns))
        spread = [np.broadcast_to(column.codes, shape).ravel() for column in columns]
        rows, inverse = _distinct(spread, [column.levels.size for column in columns])
        read = {
            name: (column.levels, codes[rows])
            for name, column, codes in zip(names, columns, spread, strict=True)
        }
        return Combinations(shape, inverse, len(rows), read)


class Columns(Mapping[str, Column]):
    """Columns that keep the combinations found in them, for many expressions that read the same ones."""

    @cached_property
    def _found(self) -> dict[tuple[str, ...], Combinations]:
        return {}

    def combinations(self, names: tuple[str, ...]) -> Combinations:
        """Return the combinations of the columns with some names."""
        if names not in self._found:
            self._found[names] = Combinations.of(names, self)
        return self._found[names]


def _distinct(columns: Sequence[Ints], sizes: Sequence[int]) -> tuple[Ints, Ints]:
    """Find the distinct rows of some columns of codes, each code below its column's size.

    Returns:
        int64 [M], a step of each distinct row, and int64 [B], which of them a step has.
    """
    if not columns:
        return np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    steps = np.arange(len(columns[0]))
    rows, inverse, count = steps[:1], np.zeros(len(steps), dtype=np.int64), 1
    for codes, size in zip(columns, sizes, strict=True):
        joint, possible = inverse * size + codes, count * size
        if possible > 4 * len(steps) + DENSE:
            _, rows, inverse = np.unique(joint, return_index=True, return_inverse=True)
        else:
            holder = np.full(possible, -1)
            holder[joint] = steps
            occurs = holder >= 0
            all_occur = bool(occurs.all())
            rows, inverse = holder[occurs], joint if all_occur else (np.cumsum(occurs) - 1)[joint]
        count = len(rows)
    return rows, inverse
