"""Functions of the location as compact PRISM expressions.

Locations are written as boxes of rows and columns on a grid and as runs of numbers on a graph,
never one by one: at 100 x 100 cells that builds hundreds of times faster. A chain that would be
long is split in halves: Storm evaluates it link by link (500 links build five times slower than
64), and its parser overflows the stack on a chain of thousands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.concerns.space import Space
from merap.mdp.model import Bools, Ints
from merap.prism.terms import alternatives, bare

MAX_CHAIN = 64
Box = tuple[int, int, int, int]  # first and last row, first and last column


def predicate(space: Space, mask: Bools) -> str:
    """Membership in `mask` (bool [P]): a comparison, its negation, or in parentheses."""
    return _predicate(_window(space, mask.astype(np.int64)))


def cases(space: Space, texts: Sequence[str], index: Ints) -> str:
    """The expression that is `texts[index[p]]` at location p: an atom, or in parentheses.

    Args:
        space: the locations.
        texts: alternatives, each an atom or in parentheses.
        index: int64 [P], which of them.
    """
    return _cases(_window(space, index), texts)


@dataclass(frozen=True, eq=False)
class _Window:
    """A part of the space; `values` (int64 [rows, columns]) begins at (row, column). A graph is one row."""

    names: tuple[str, str]
    values: Ints
    row: int
    column: int

    def halves(self) -> tuple[str, _Window, _Window]:
        """The longer side cut in two, and the condition for the first half."""
        rows, columns = self.values.shape
        if rows >= columns:
            cut = rows // 2
            first = _Window(self.names, self.values[:cut], self.row, self.column)
            second = _Window(self.names, self.values[cut:], self.row + cut, self.column)
            return f"{self.names[0]}<{self.row + cut}", first, second
        cut = columns // 2
        first = _Window(self.names, self.values[:, :cut], self.row, self.column)
        second = _Window(self.names, self.values[:, cut:], self.row, self.column + cut)
        return f"{self.names[1]}<{self.column + cut}", first, second

    def union(self, boxes: Sequence[Box]) -> str:
        """Membership in any of the boxes."""
        return alternatives([self._membership(box) for box in boxes])

    def _membership(self, box: Box) -> str:
        rows, columns = self.values.shape
        conditions = [
            *_bounds(self.names[0], box[0], box[1], rows - 1, self.row),
            *_bounds(self.names[1], box[2], box[3], columns - 1, self.column),
        ]
        text = " & ".join(conditions)
        return f"({text})" if len(conditions) > 1 else text


def _window(space: Space, values: Ints) -> _Window:
    shape = space.shape or (1, space.num_locations)
    names = space.variable_names
    return _Window((names[0], names[-1]), values.reshape(shape), 0, 0)


def _bounds(name: str, first: int, last: int, end: int, offset: int) -> list[str]:
    if first == last and end > 0:
        return [f"{name}={first + offset}"]
    lower = [f"{name}>={first + offset}"] if first > 0 else []
    return lower + ([f"{name}<={last + offset}"] if last < end else [])


def _predicate(window: _Window) -> str:
    boxes = _boxes(window.values)
    if len(boxes) == 1:
        return "true" if 1 in boxes else "false"
    if min(len(boxes[0]), len(boxes[1])) > MAX_CHAIN:
        condition, first, second = window.halves()
        return f"({condition} ? {_predicate(first)} : {_predicate(second)})"
    if len(boxes[1]) <= len(boxes[0]):
        return window.union(boxes[1])
    return f"!({bare(window.union(boxes[0]))})"


def _cases(window: _Window, texts: Sequence[str]) -> str:
    boxes = _boxes(window.values)
    counts = {value: sum(map(_size, parts)) for value, parts in boxes.items()}
    default = max(counts, key=lambda value: counts[value])
    others = [value for value in boxes if value != default]
    if sum(len(boxes[value]) for value in others) > MAX_CHAIN:
        condition, first, second = window.halves()
        return f"({condition} ? {_cases(first, texts)} : {_cases(second, texts)})"
    chain = "".join(f"{bare(window.union(boxes[value]))} ? {texts[value]} : " for value in others)
    return f"({chain}{texts[default]})" if others else texts[default]


def _size(box: Box) -> int:
    return (box[1] - box[0] + 1) * (box[3] - box[2] + 1)


def _boxes(values: Ints) -> dict[int, list[Box]]:
    """Disjoint boxes that cover each value of `values` (int64 [rows, columns]), in order of appearance.

    They are runs within a row; equal ones in adjoining rows are merged.
    """
    found: dict[int, list[Box]] = {}
    growing: dict[tuple[int, int, int], int] = {}
    for row in range(len(values) + 1):
        runs = dict.fromkeys(_runs(values[row]) if row < len(values) else ())
        for run in [run for run in growing if run not in runs]:
            first, last, value = run
            found[value].append((growing.pop(run), row - 1, first, last))
        for run in runs:
            growing.setdefault(run, row)
            found.setdefault(run[2], [])
    return {value: sorted(boxes) for value, boxes in found.items()}


def _runs(row: Ints) -> list[tuple[int, int, int]]:
    """First and last column and value of each run of equal values."""
    begins = np.flatnonzero(np.diff(row, prepend=row[0] - 1))
    ends = np.append(begins[1:], len(row)) - 1
    return list(zip(begins.tolist(), ends.tolist(), row[begins].tolist(), strict=True))
