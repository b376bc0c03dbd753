"""The spatial environment without its configurations: locations, edges, attributes, detectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from merap.mdp.model import Bools, Floats, Ints
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import Column


@dataclass(frozen=True, eq=False, repr=False)
class Attribute(ShortRepr):
    """A value at every location (`Atr` of the paper's Definition 1).

    Attributes:
        name: how expressions call it.
        kind: `bool`, `int` or `real`.
        low: least value allowed.
        high: greatest value allowed.
        values: float64 [P]; 0 and 1 for a `bool`.
    """

    name: str
    kind: Literal["bool", "int", "real"]
    low: float
    high: float
    values: Floats

    @cached_property
    def column(self) -> Column:
        """What expressions read at the P locations: truth values of a `bool`, else exact decimals."""
        return Column.of(self.values.astype(np.bool_) if self.kind == "bool" else self.values)


@dataclass(frozen=True)
class Detector:
    """A sensor that is read online (`Det` of Definition 1).

    Attributes:
        name: the sensor's name.
        of: `blocked`, or an attribute.
        range: number of edges it looks ahead; 0 sees the own location alone.
        accuracy: probability that one reading is right, in [0, 1].
    """

    name: str
    of: str
    range: int
    accuracy: float


@dataclass(frozen=True, eq=False, repr=False)
class Door(ShortRepr):
    """A door between two locations: a variable of the state that says whether it is open.

    Attributes:
        name: of the door and of its variable.
        edges: bool [P, L], those that lead through it, in both directions.
    """

    name: str
    edges: Bools


@dataclass(frozen=True, eq=False, repr=False)
class Space(ShortRepr):
    """A location graph (P locations, L edge labels).

    Attributes:
        locations: P names; on a grid `r<row>c<col>`, row by row.
        positions: float64 [P, 2], metres (x, y), for drawing.
        moves: L edge labels, in order of their first appearance.
        target: int64 [P, L], where the edge with that label leads; -1 where there is none.
        shape: (rows, columns) of a grid, None for a graph.
        attributes: in declared order, with their default values.
        detectors: in declared order.
        doors: in declared order.
        located: whether the location is part of the state; a case without space has one place, of which
            no state and no observation speaks.
    """

    locations: tuple[str, ...]
    positions: Floats
    moves: tuple[str, ...]
    target: Ints
    shape: tuple[int, int] | None
    attributes: tuple[Attribute, ...]
    detectors: tuple[Detector, ...]
    doors: tuple[Door, ...] = ()
    located: bool = True

    @property
    def num_locations(self) -> int:
        """P."""
        return len(self.locations)

    @cached_property
    def location_index(self) -> Mapping[str, int]:
        """Name -> index; empty without space."""
        if not self.located:
            return {}
        return {name: index for index, name in enumerate(self.locations)}

    @property
    def variable_names(self) -> tuple[str, ...]:
        """The state variables that hold a location: `row, col` on a grid, else `loc`; none without space."""
        if not self.located:
            return ()
        return ("loc",) if self.shape is None else ("row", "col")

    @property
    def valuations(self) -> Ints:
        """int64 [P, 0 to 2], the values of `variable_names` at every location."""
        indices = np.arange(self.num_locations)
        if not self.located:
            return indices[:, None][:, :0]
        if self.shape is None:
            return indices[:, None]
        return np.stack(np.divmod(indices, self.shape[1]), axis=1)


NO_SPACE = Space(
    locations=("here",),
    positions=np.zeros((1, 2)),
    moves=(),
    target=np.zeros((1, 0), dtype=np.int64),
    shape=None,
    attributes=(),
    detectors=(),
    located=False,
)


def passable(space: Space, closed: Bools, closed_edges: Bools) -> Bools:
    """bool [P, L]: the move exists, its edge is open and its target may be entered.

    Args:
        space: the locations and edges.
        closed: bool [P], locations nobody can go to.
        closed_edges: bool [P, L], edges nobody can use.
    """
    exists = space.target >= 0
    return exists & ~closed_edges & ~closed[np.where(exists, space.target, 0)]
