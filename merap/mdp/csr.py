"""Work on compressed sparse rows (CSR): row s is `values[pointers[s]:pointers[s + 1]]`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def pointers_of(lengths: Ints) -> Ints:
    """Return the pointers of rows with these lengths.

    Args:
        lengths: int64 [S].

    Returns:
        int64 [S + 1], rising from 0.
    """
    return np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(lengths)))


def ragged_indices(pointers: Ints, rows: Ints) -> Ints:
    """Return the indices of all entries of some rows, row by row.

    Args:
        pointers: int64 [S + 1].
        rows: int64 [M], row numbers.

    Returns:
        int64 [sum of the rows' lengths].
    """
    lengths = pointers[rows + 1] - pointers[rows]
    ends = np.cumsum(lengths)
    total = int(ends[-1]) if len(ends) else 0
    shift: Ints = np.repeat(pointers[rows] - (ends - lengths), lengths)
    return shift + np.arange(total)


def row_best(values: Floats, pointers: Ints, *, maximise: bool, empty: float = 0.0) -> Floats:
    """Return the largest (or smallest) entry of each row.

    Args:
        values: float64 [C].
        pointers: int64 [S + 1].
        maximise: largest or smallest.
        empty: the result for an empty row.

    Returns:
        float64 [S].
    """
    occupied = pointers[:-1] < pointers[1:]
    best = np.full(len(pointers) - 1, empty)
    if len(values):
        # reduceat reads an empty row as one entry, so rows without entries are left out.
        best[occupied] = (np.maximum if maximise else np.minimum).reduceat(values, pointers[:-1][occupied])
    return best


def first_match(values: Floats, wanted: Floats, row_of: Ints) -> Ints:
    """Find the first entry of each row that equals the value wanted of the row.

    Args:
        values: float64 [C].
        wanted: float64 [S].
        row_of: int64 [C], the row of each entry, ascending.

    Returns:
        int64 [S], an index into `values`; -1 where no entry is equal.
    """
    matching = np.flatnonzero(values == wanted[row_of])
    rows = row_of[matching]
    first = np.ones(len(rows), dtype=np.bool_)
    first[1:] = rows[1:] != rows[:-1]
    found = np.full(len(wanted), -1, dtype=np.int64)
    found[rows[first]] = matching[first]
    return found
