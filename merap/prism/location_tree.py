"""Write functions of the location as compact trees: boxes of rows and columns, or runs of numbers.

At 100 x 100 cells text of boxes builds hundreds of times faster than one case for each cell. A chain that
would be long is split in halves: Storm evaluates it link by link (500 links build five times slower than 64),
and its parser overflows the stack on a chain of thousands.

Axes: R rows, C columns (a graph is one row), K boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merap.mdp.model import Ints
from merap.program.expressions import Constant, Expression, Operation, Variable, all_of, any_of, number

MAX_CHAIN = 64


def location_tree(
    variables: Sequence[str], lows: Sequence[int], values: Ints, leaves: Sequence[Constant]
) -> Expression:
    """Return the expression that is `leaves[values[r, c]]` where the location is row r, column c.

    Args:
        variables: the names of the row and the column; of a graph one name.
        lows: their least values.
        values: int64 [R, C], which of the leaves; of a graph [1, C].
        leaves: distinct; truth values or numbers.
    """
    row, column = ("", *variables)[-2:], (0, *lows)[-2:]
    window = _Window((row[0], row[1]), values, column[0], column[1])
    if isinstance(leaves[0].value, bool):
        return _predicate(window, np.array([leaf.value for leaf in leaves], dtype=np.bool_))
    return _cases(window, leaves)


@dataclass(frozen=True, eq=False)
class _Window:
    """A part of the locations; `values` (int64 [R, C]) begins at (row, column)."""

    names: tuple[str, str]
    values: Ints
    row: int
    column: int

    def halves(self) -> tuple[Expression, _Window, _Window]:
        """Return the condition for the first half, and both halves of the longer side."""
        rows, columns = self.values.shape
        if rows >= columns:
            cut = rows // 2
            first = _Window(self.names, self.values[:cut], self.row, self.column)
            second = _Window(self.names, self.values[cut:], self.row + cut, self.column)
            return _compared(self.names[0], "<", self.row + cut), first, second
        cut = columns // 2
        first = _Window(self.names, self.values[:, :cut], self.row, self.column)
        second = _Window(self.names, self.values[:, cut:], self.row, self.column + cut)
        return _compared(self.names[1], "<", self.column + cut), first, second

    def union(self, boxes: Ints) -> Expression:
        """Return the membership in any of some boxes (rows of `_boxes`)."""
        return any_of(self._membership(*box) for box in boxes.tolist())

    def _membership(self, top: int, bottom: int, left: int, right: int) -> Expression:
        rows, columns = self.values.shape
        return all_of(
            [
                *_bounds(self.names[0], top, bottom, rows - 1, self.row),
                *_bounds(self.names[1], left, right, columns - 1, self.column),
            ]
        )


def _compared(name: str, symbol: str, value: int) -> Expression:
    return Operation(symbol, (Variable(name, 0), number(value)))


def _bounds(name: str, first: int, last: int, end: int, offset: int) -> list[Expression]:
    if first == last and end > 0:
        return [_compared(name, "=", first + offset)]
    lower = [_compared(name, ">=", first + offset)] if first > 0 else []
    return lower + ([_compared(name, "<=", last + offset)] if last < end else [])


def _predicate(window: _Window, truths: npt.NDArray[np.bool_]) -> Expression:
    holds = truths[window.values].astype(np.int64)
    if holds.min() == holds.max():
        return Constant(bool(holds.flat[0]))
    boxes, values = _boxes(holds)
    inside, outside = boxes[values == 1], boxes[values == 0]
    if min(len(inside), len(outside)) > MAX_CHAIN:
        condition, first, second = window.halves()
        return Operation("?:", (condition, _predicate(first, truths), _predicate(second, truths)))
    if len(inside) <= len(outside):
        return window.union(inside)
    return Operation("!", (window.union(outside),))


def _cases(window: _Window, leaves: Sequence[Constant]) -> Expression:
    boxes, values = _boxes(window.values)
    default = int(np.argmax(np.bincount(window.values.ravel())))
    others = values != default
    if np.count_nonzero(others) > MAX_CHAIN:
        condition, first, second = window.halves()
        return Operation("?:", (condition, _cases(first, leaves), _cases(second, leaves)))
    tree: Expression = leaves[default]
    for value in dict.fromkeys(values[others][::-1].tolist()):
        tree = Operation("?:", (window.union(boxes[values == value]), leaves[value], tree))
    return tree


def _boxes(values: Ints) -> tuple[Ints, Ints]:
    """Cut a window into disjoint boxes of equal values.

    They are runs within a row; equal ones in adjoining rows are merged.

    Returns:
        int64 [K, 4], first and last row, first and last column, by their first cell; and int64 [K], values.
    """
    columns = values.shape[1]
    flat = values.ravel()
    begins = np.ones(values.shape, dtype=np.bool_)
    begins[:, 1:] = values[:, 1:] != values[:, :-1]
    first = np.flatnonzero(begins)  # [runs], row by row
    last = np.append(first[1:], flat.size) - 1
    run = np.cumsum(begins.ravel()) - 1  # [R * C]
    above = run[np.maximum(first - columns, 0)]
    continues = (
        (first >= columns)
        & (first[above] == first - columns)
        & (last[above] == last - columns)
        & (flat[first[above]] == flat[first])
    )
    head = np.where(continues, above, np.arange(len(first)))
    while np.any(head[head] != head):
        head = head[head]
    bottom = np.zeros(len(first), dtype=np.int64)
    np.maximum.at(bottom, head, first // columns)
    top = np.flatnonzero(~continues)
    boxes = np.stack([first[top] // columns, bottom[top], first[top] % columns, last[top] % columns], axis=1)
    return boxes, flat[first[top]]
