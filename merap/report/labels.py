"""Where the names of locations go, so that they don't cover each other or the map.

Axes: P locations, D candidate places around each, M points to keep clear. All in inches.
"""

from __future__ import annotations

import numpy as np

from merap.mdp.model import Bools, Floats

# Unit vectors to the candidates: below and above first, as they keep a name next to its circle.
_SIDES = np.array([[0, -1], [0, 1], [1, 0], [-1, 0], [1, -1], [-1, -1], [1, 1], [-1, 1]], dtype=np.float64)
_DISTASTE = np.array([0.0, 0.02, 0.04, 0.06, 0.1, 0.12, 0.14, 0.16])
_GAP = 0.03
_ROUNDS = 4
_OVERLAP_COST = 40.0
_POINT_COST = 0.15
_OUTSIDE_COST = 10.0


def place_labels(
    anchors: Floats, radii: Floats, sizes: Floats, points: Floats, page: tuple[Floats, Floats]
) -> Floats:
    """Choose a place for each name: greedily, then again in view of all others.

    Args:
        anchors: float64 [P, 2], centres of the circles.
        radii: float64 [P], of the circles.
        sizes: float64 [P, 2], widths and heights of the names.
        points: float64 [M, 2], points on the edges.
        page: two corners, float64 [2] each, between which names have to be.

    Returns:
        float64 [P, 2], centres of the names.
    """
    centres = _candidates(anchors, radii, sizes)
    own_cost = _DISTASTE + _POINT_COST * _points_inside(centres, sizes, points)
    own_cost += _OUTSIDE_COST * _outside(centres, sizes, page)
    own_cost += _OVERLAP_COST * _circles_touched(centres, sizes, anchors, radii)
    chosen = own_cost.argmin(axis=1)
    rows = np.arange(len(anchors))
    for _ in range(_ROUNDS):
        for name in rows:
            others = rows != name
            overlap = _overlap(centres[name], sizes[name], centres[rows, chosen][others], sizes[others])
            chosen[name] = (own_cost[name] + _OVERLAP_COST * overlap).argmin()
    placed: Floats = centres[rows, chosen]
    return placed


def _candidates(anchors: Floats, radii: Floats, sizes: Floats) -> Floats:
    """Return float64 [P, D, 2], boxes that touch the circle on one side or at a corner."""
    corner = np.abs(_SIDES).sum(axis=1) > 1
    reach = np.where(corner, np.sqrt(0.5), 1.0)[None, :, None] * radii[:, None, None] + _GAP
    return anchors[:, None] + _SIDES * (reach + sizes[:, None] / 2)


def _outside(centres: Floats, sizes: Floats, page: tuple[Floats, Floats]) -> Bools:
    """Return bool [P, D], whether a name would leave the page there."""
    low, high = page
    half = sizes[:, None] / 2
    leaves: Bools = np.any((centres - half < low) | (centres + half > high), axis=2)
    return leaves


def _points_inside(centres: Floats, sizes: Floats, points: Floats) -> Floats:
    """Return float64 [P, D], the number of points a name would cover there."""
    counts = np.zeros(centres.shape[:2])
    for name, size in enumerate(sizes):
        apart = np.abs(centres[name][:, None] - points[None])
        counts[name] = (apart < size / 2 + _GAP).all(axis=2).sum(axis=1)
    return counts


def _circles_touched(centres: Floats, sizes: Floats, anchors: Floats, radii: Floats) -> Floats:
    """Return float64 [P, D], the number of circles a name would touch there, its own left out."""
    beyond = np.abs(centres[:, :, None] - anchors) - sizes[:, None, None] / 2
    distance = np.linalg.norm(np.maximum(beyond, 0), axis=3)
    touched = distance < radii + _GAP / 2
    own = np.arange(len(anchors))
    touched[own, :, own] = False
    counts: Floats = touched.sum(axis=2).astype(np.float64)
    return counts


def _overlap(centres: Floats, size: Floats, others: Floats, sizes: Floats) -> Floats:
    """Return float64 [D], the number of other names a name would touch there."""
    apart = np.abs(centres[:, None] - others)
    counts: Floats = (apart < (size + sizes) / 2 + _GAP).all(axis=2).sum(axis=1).astype(np.float64)
    return counts
