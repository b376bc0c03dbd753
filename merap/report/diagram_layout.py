"""Where the parts of a state diagram go, so that nothing covers anything.

Nodes stand in a line. Arrows to the right run above them, arrows to the left below, each at a level of its
own among those that it overlaps, and leave and enter nodes at points of their own. All lengths are inches.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np

from merap.mdp.model import Floats
from merap.report.diagrams import Arrow, Diagram
from merap.report.extent import name_sizes

TEXT_SIZE, NOTE_SIZE = 9.0, 7.5
TITLE = 0.3
LINE, NOTE_LINE = 0.16, 0.135
_MARGIN, _GAP, _PORT = 0.1, 0.16, 0.1
_LETTERS = 20


@dataclass(frozen=True, eq=False)
class Route:
    """An arrow on paper.

    Attributes:
        points: float64 [4, 2]: up from a node (or down), along, and to the other node.
        lines: its text.
        centre: float64 [2], the middle of the text.
    """

    points: Floats
    lines: tuple[str, ...]
    centre: Floats


@dataclass(frozen=True, eq=False)
class Layout:
    """A diagram on paper; the origin is its lower left corner.

    Attributes:
        diagram: what is drawn.
        size: float64 [2].
        centres: float64 [nodes, 2].
        boxes: float64 [nodes, 2], widths and heights.
        notes: for each node, the lines under its value.
        routes: the arrows.
    """

    diagram: Diagram
    size: Floats
    centres: Floats
    boxes: Floats
    notes: tuple[tuple[str, ...], ...]
    routes: tuple[Route, ...]


def lay_out(diagram: Diagram) -> Layout:
    """Place the parts of a diagram."""
    notes = tuple(_wrapped(node.notes) for node in diagram.nodes)
    above, below = (_Side.of(diagram, rightwards) for rightwards in (True, False))
    boxes = np.array(
        [
            [
                max(
                    _width([node.text], TEXT_SIZE) + 0.16,
                    _width(own, NOTE_SIZE) + 0.12,
                    _PORT * (2 + max(above.ports(place), below.ports(place))),
                ),
                LINE + 0.1 + NOTE_LINE * max(map(len, notes)),
            ]
            for place, (node, own) in enumerate(zip(diagram.nodes, notes, strict=True))
        ]
    )
    gaps = np.maximum(above.gaps(), below.gaps())
    left = np.concatenate([[0.0], np.cumsum(boxes[:-1, 0] + gaps)]) + _MARGIN
    bottom = _MARGIN + below.height
    centres = np.stack([left + boxes[:, 0] / 2, np.full(len(boxes), bottom + boxes[0, 1] / 2)], axis=1)
    width = max(left[-1] + boxes[-1, 0], _width([diagram.title], TEXT_SIZE)) + _MARGIN
    size = np.array([width, bottom + boxes[0, 1] + above.height + TITLE + _MARGIN])
    routes = (*above.routes(centres, boxes), *below.routes(centres, boxes))
    return Layout(diagram, size, centres, boxes, notes, routes)


def _wrapped(lines: Sequence[str]) -> tuple[str, ...]:
    return tuple(part for line in lines for part in textwrap.wrap(line, _LETTERS))


def _width(lines: Sequence[str], size: float) -> float:
    return float(name_sizes(tuple(lines), size)[:, 0].max()) if lines else 0.0


class _Side:
    """The arrows above the nodes, or those below; below, all is as above in a mirror.

    A node at the left is the source of arrows above and the target of arrows below.
    """

    def __init__(self, num_nodes: int, arrows: Sequence[Arrow], upwards: bool) -> None:
        self._num_nodes, self._arrows, self._upwards = num_nodes, arrows, upwards
        self._texts = [_wrapped(arrow.lines) for arrow in arrows]
        self._ends = [(min(one.source, one.target), max(one.source, one.target)) for one in arrows]
        self._levels = self._levelled()
        highest = max(self._levels, default=-1)
        lines = [
            max(len(text) for text, own in zip(self._texts, self._levels, strict=True) if own == level)
            for level in range(highest + 1)
        ]
        # the height of each level's line over the nodes; its text stands on it
        self._heights = np.concatenate([[_GAP], _GAP + np.cumsum([_GAP + NOTE_LINE * n for n in lines])])
        self.height = float(self._heights[-1]) - _GAP + 0.05 if arrows else 0.0

    @classmethod
    def of(cls, diagram: Diagram, rightwards: bool) -> _Side:
        """Return the side of the arrows in one direction, short ones first."""
        arrows = [one for one in diagram.arrows if (one.source < one.target) == rightwards]
        arrows.sort(key=lambda one: (abs(one.source - one.target), one.source))
        return cls(len(diagram.nodes), arrows, rightwards)

    def _levelled(self) -> list[int]:
        """Put each arrow above those within it, and apart from those that it overlaps."""
        levels: list[int] = []
        for place, (left, right) in enumerate(self._ends):
            shorter = list(zip(self._ends[:place], levels, strict=True))
            within = [level for (first, last), level in shorter if left <= first and last <= right]
            taken = {level for (first, last), level in shorter if first < right and left < last}
            lowest = max(within, default=-1) + 1
            levels.append(next(level for level in count(lowest) if level not in taken))
        return levels

    def ports(self, node: int) -> int:
        """Return how many arrows leave or enter a node."""
        return sum(node in ends for ends in self._ends)

    def _port_order(self, node: int) -> list[int]:
        """Return the arrows at a node from left to right, so that they cross as little as possible."""
        ending = [place for place, (_, right) in enumerate(self._ends) if right == node]
        starting = [place for place, (left, _) in enumerate(self._ends) if left == node]
        ending.sort(key=lambda place: self._levels[place])
        starting.sort(key=lambda place: -self._levels[place])
        return [*ending, *starting]

    def _text_gap(self, place: int) -> int:
        """Return the gap between nodes, by the node at its left, over which an arrow's text stands."""
        left, right = self._ends[place]
        return (left + right - 1) // 2

    def gaps(self) -> Floats:
        """float64 [nodes - 1], the least distances of neighbours that leave room for the texts."""
        gaps = np.full(self._num_nodes - 1, 0.3)
        for place, text in enumerate(self._texts):
            gap = self._text_gap(place)
            gaps[gap] = max(gaps[gap], _width(text, NOTE_SIZE) + 0.08)
        return gaps

    def routes(self, centres: Floats, boxes: Floats) -> list[Route]:
        """Return the arrows on paper."""
        sign = 1 if self._upwards else -1
        ports: dict[tuple[int, int], float] = {}
        for node in range(self._num_nodes):
            order = self._port_order(node)
            shifts = _PORT * (np.arange(len(order)) - (len(order) - 1) / 2)
            for place, shift in zip(order, shifts.tolist(), strict=True):
                ports[node, place] = centres[node, 0] + shift
        routes = []
        for place, (arrow, text) in enumerate(zip(self._arrows, self._texts, strict=True)):
            base = centres[arrow.source, 1] + sign * boxes[0, 1] / 2
            along = base + sign * self._heights[self._levels[place]]
            start, end = ports[arrow.source, place], ports[arrow.target, place]
            gap = self._text_gap(place)
            middle = (centres[gap, 0] + boxes[gap, 0] / 2 + centres[gap + 1, 0] - boxes[gap + 1, 0] / 2) / 2
            centre = np.array([middle, along + sign * (0.03 + NOTE_LINE * len(text) / 2)])
            points = np.array([[start, base], [start, along], [end, along], [end, base]])
            routes.append(Route(points, text, centre))
        return routes
