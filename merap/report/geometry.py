"""Lines, arrows and label places of a map, as arrays of points in the units of the map.

Axes: P locations, E pairs of locations that edges join, K points of a line, M anything. Points
are float64 [..., 2], x to the right and y upwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from merap.concerns.space import Space
from merap.mdp.model import Bools, Floats, Ints

# A line that would run through another location is bent aside by this part of its length.
BEND = 0.16
BENT_POINTS = 25


def spacing_of(positions: Floats) -> float:
    """Return the least distance between two of the positions [P, 2] that differ; 1 if none do."""
    distinct = np.unique(positions, axis=0)
    if len(distinct) < 2:
        return 1.0
    return float(cKDTree(distinct).query(distinct, k=2)[0][:, 1].min())


@dataclass(frozen=True, eq=False)
class EdgeLines:
    """The lines along which a map draws edges, one for each pair of locations.

    Attributes:
        positions: float64 [P, 2].
        pairs: int64 [E, 2], joined locations, the smaller index first.
        forward: bool [E, 2]: some edge leads from first to second; some such edge is open.
        backward: bool [E, 2]: the same from second to first.
        bent: bool [E], the line makes way for a location between the two.
    """

    positions: Floats
    pairs: Ints
    forward: Bools
    backward: Bools
    bent: Bools

    @property
    def any_blocked(self) -> Bools:
        """bool [E]: one direction or both can't be taken though there is an edge."""
        blocked: Bools = (self.forward[:, 0] & ~self.forward[:, 1]) | (
            self.backward[:, 0] & ~self.backward[:, 1]
        )
        return blocked

    @cached_property
    def lines(self) -> list[Floats]:
        """E lines float64 [K, 2] from the first to the second location."""
        ends = self.positions[self.pairs]
        return [
            _bend(first, second) if bent else np.stack([first, second])
            for (first, second), bent in zip(ends, self.bent, strict=True)
        ]

    @cached_property
    def _index(self) -> dict[tuple[int, int], int]:
        return {(int(first), int(second)): index for index, (first, second) in enumerate(self.pairs)}

    def between(self, source: int, target: int) -> Floats:
        """Return float64 [K, 2], from source to target; straight where no edge joins them."""
        index = self._index.get((min(source, target), max(source, target)))
        if index is None:
            return self.positions[[source, target]]
        return self.lines[index] if source < target else self.lines[index][::-1]

    def along(self, locations: Sequence[int]) -> tuple[Floats, Ints]:
        """Return the line through a sequence of locations that differ from one to the next.

        Returns:
            float64 [K, 2], its points; int64, the first point of the middle piece of each hop.
        """
        hops = [self.between(*hop) for hop in pairwise(locations)]
        sizes = np.array([len(hop) - 1 for hop in hops])
        points = np.concatenate([self.positions[[locations[0]]], *(hop[1:] for hop in hops)])
        return points, np.cumsum(sizes) - sizes + (sizes - 1) // 2


def edge_lines(space: Space, blocked_edges: Bools, clearance: float) -> EdgeLines:
    """Collect the edges of a space into lines.

    Args:
        space: the locations and edges.
        blocked_edges: bool [P, L].
        clearance: a line that comes closer to a third location than this is bent; 0 bends none.
    """
    source, label = np.nonzero(space.target >= 0)
    target = space.target[source, label]
    is_loop = source == target
    source, target = source[~is_loop], target[~is_loop]
    is_open = ~blocked_edges[space.target >= 0][~is_loop]
    ordered = np.stack([np.minimum(source, target), np.maximum(source, target)], axis=1)
    pairs, inverse = np.unique(ordered, axis=0, return_inverse=True)
    forward = np.zeros((len(pairs), 2), dtype=np.bool_)
    backward = np.zeros((len(pairs), 2), dtype=np.bool_)
    upward = source < target
    forward[inverse[upward], 0] = True
    forward[inverse[upward & is_open], 1] = True
    backward[inverse[~upward], 0] = True
    backward[inverse[~upward & is_open], 1] = True
    bent = _runs_through_another(space.positions, pairs, clearance)
    return EdgeLines(space.positions, pairs, forward, backward, bent)


def _runs_through_another(positions: Floats, pairs: Ints, clearance: float) -> Bools:
    """Return bool [E], a third location is nearer to the straight line than `clearance`."""
    first, second = positions[pairs[:, 0]], positions[pairs[:, 1]]
    tree = cKDTree(positions)
    length = np.linalg.norm(second - first, axis=1)
    near = np.zeros(len(pairs), dtype=np.bool_)
    if clearance == 0:
        return near
    # Only lines longer than two clearances have room for a third location between.
    for index in np.flatnonzero(length > 2 * clearance):
        around = tree.query_ball_point((first[index] + second[index]) / 2, length[index] / 2 + clearance)
        others = np.setdiff1d(around, pairs[index])
        direction = (second[index] - first[index]) / length[index]
        offset = positions[others] - first[index]
        along = offset @ direction
        across = np.abs(offset @ np.array([-direction[1], direction[0]]))
        near[index] = np.any((across < clearance) & (along > 0) & (along < length[index]))
    return near


def _bend(first: Floats, second: Floats) -> Floats:
    """Return an arc as a quadratic Bezier curve, float64 [K, 2]."""
    t = np.linspace(0, 1, BENT_POINTS)[:, None]
    across = np.array([first[1] - second[1], second[0] - first[0]])
    control = (first + second) / 2 + 2 * BEND * across
    curve: Floats = (1 - t) ** 2 * first + 2 * t * (1 - t) * control + t**2 * second
    return curve


def directions_of(points: Floats) -> Floats:
    """Return float64 [K - 1, 2], unit vectors along the pieces of a line [K, 2]."""
    return unit(np.diff(points, axis=0))


def unit(vectors: Floats) -> Floats:
    """Scale vectors [..., 2] to length 1; those of length 0 stay."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    scaled: Floats = vectors / np.where(length > 0, length, 1)
    return scaled


def right_of(directions: Floats) -> Floats:
    """Turn unit vectors [..., 2] to their right."""
    return np.stack([directions[..., 1], -directions[..., 0]], axis=-1)


def offset_line(points: Floats, offset: float) -> Floats:
    """Move a line to its right: pieces stay parallel, bends get a mitre, sharp ones a bevel.

    Args:
        points: float64 [K, 2], K at least 2, no two neighbours equal.
        offset: in the units of the map.

    Returns:
        float64 [2 K, 2]: where a bend has a mitre, its point twice.
    """
    normals = right_of(directions_of(points))
    before = np.concatenate([normals[:1], normals])
    after = np.concatenate([normals, normals[-1:]])
    cosine = (before * after).sum(axis=1, keepdims=True)
    mitre = (before + after) / np.maximum(1 + cosine, 0.5)
    sharp = cosine < -0.1
    both_sides = np.stack([np.where(sharp, before, mitre), np.where(sharp, after, mitre)], axis=1)
    moved: Floats = (points[:, None, :] + offset * both_sides).reshape(-1, 2)
    return moved


def triangles(centres: Floats, directions: Floats, size: float) -> Floats:
    """Return float64 [M, 3, 2], arrow heads that point along unit vectors [M, 2]."""
    along, across = directions * size, right_of(directions) * size * 0.62
    return np.stack(
        [centres + 0.6 * along, centres - 0.4 * along + across, centres - 0.4 * along - across], axis=1
    )


def arrows(tails: Floats, directions: Floats, length: float, widths: Floats) -> Floats:
    """Return float64 [M, 7, 2], arrows as outlines.

    Args:
        tails: float64 [M, 2].
        directions: float64 [M, 2], unit vectors.
        length: from tail to tip.
        widths: float64 [M], of the shaft; the head is 2.6 times as wide.
    """
    along = directions * length
    across = right_of(directions) * widths[:, None] / 2
    neck = tails + 0.55 * along
    corners = [
        tails + across,
        neck + across,
        neck + 2.6 * across,
        tails + along,
        neck - 2.6 * across,
        neck - across,
        tails - across,
    ]
    return np.stack(corners, axis=1)
