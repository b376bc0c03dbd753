"""Turn rows of integers into single keys, to match states by valuation without a loop."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]

_KEY_SPACE = 2**62


def row_keys(*tables: Ints) -> tuple[Ints, ...]:
    """Return one integer per row, equal exactly where rows are equal, across all tables.

    Rows are read as numbers in a mixed radix; where 62 bits are too few for that, the keys
    are ranks among the sorted distinct rows. Keys mean nothing beyond one call.

    Args:
        tables: int64 [M_i, V] each, one V for all.

    Returns:
        int64 [M_i] for each table.
    """
    stacked = np.concatenate(tables)
    keys = _stacked_keys(stacked) if stacked.size else np.zeros(len(stacked), dtype=np.int64)
    ends = np.cumsum([len(table) for table in tables])
    return tuple(np.split(keys, ends[:-1]))


def _stacked_keys(stacked: Ints) -> Ints:
    low = stacked.min(axis=0)
    # Python integers, since a span of int64 need not fit into int64.
    spans = [int(high) - int(least) + 1 for high, least in zip(stacked.max(axis=0), low, strict=True)]
    if math.prod(spans) > _KEY_SPACE:
        return np.unique(stacked, axis=0, return_inverse=True)[1].reshape(-1)
    keys = np.zeros(len(stacked), dtype=np.int64)
    for column, span in enumerate(spans):
        keys = keys * span + (stacked[:, column] - low[column])
    return keys


def match_rows(rows: Ints, table: Ints) -> Ints:
    """Find each row in a table of distinct rows.

    Args:
        rows: int64 [M, V].
        table: int64 [S, V].

    Returns:
        int64 [M], an index into the table; -1 for a row that isn't there.
    """
    return match_keys(*row_keys(rows, table))


def match_keys(keys: Ints, table: Ints) -> Ints:
    """Find each key in a table of distinct keys.

    Args:
        keys: int64 [M].
        table: int64 [S].

    Returns:
        int64 [M], an index into the table; -1 for a key that isn't there.
    """
    if len(table) == 0:
        return np.full(len(keys), -1, dtype=np.int64)
    order = np.argsort(table, kind="stable")
    ordered = table[order]
    place = np.minimum(np.searchsorted(ordered, keys), len(ordered) - 1)
    return np.where(ordered[place] == keys, order[place], -1)


def first_repeat(keys: Ints) -> tuple[int, int] | None:
    """Return the indices (earlier, later) of two equal entries; None if all differ.

    Args:
        keys: int64 [M].
    """
    if np.all(keys[1:] > keys[:-1]):
        return None  # already in order, as engines write them: no sort needed
    order = np.argsort(keys, kind="stable")
    twice = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    return (int(order[twice[0]]), int(order[twice[0] + 1])) if len(twice) else None
