"""Draw the doors of a map: open or closed at first, or locked.

Axes: D doors.
"""

from __future__ import annotations

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.report.geometry import EdgeLines
from merap.report.sheet import Panel
from merap.report.style import INK, ORANGE, VERMILLION, Entry, mark

_SIZE = {True: 0.35, False: 0.75}
_FACES = {"open": "white", "closed": ORANGE, "locked": VERMILLION}
_MEANINGS = {"open": "door, open at first", "closed": "door, closed at first", "locked": "door, locked"}


def draw_doors(panel: Panel, mdp: TabularMDP) -> list[Entry]:
    """Draw a square in the middle of the edge that leads through a door; a locked one has a cross.

    Args:
        panel: where to.
        mdp: the model of its combination, which says how the doors are at first.
    """
    entries: list[Entry] = []
    middles, how = door_middles(panel), _how_doors_are(panel.combination, mdp)
    size = _SIZE[panel.extent.is_grid] * 2 * panel.extent.radius_in_points
    for kind, mask in how.items():
        if not mask.any():
            continue
        layers = [
            ("s", _FACES[kind], INK, 1.0),
            *([("x", "white", "white", 0.6)] if kind == "locked" else []),
        ]
        for marker, face, edge, part in layers:
            panel.axes.plot(
                *middles[mask].T,
                linestyle="none",
                marker=marker,
                markersize=size * part,
                markerfacecolor=face,
                markeredgecolor=edge,
                markeredgewidth=1.3,
                zorder=4.5,
                gid=_MEANINGS[kind],
            )
        marks = tuple(mark(marker, face, edge=edge, size=0.8 * part) for marker, face, edge, part in layers)
        entries.append((marks, _MEANINGS[kind]))
    return entries


def door_middles(panel: Panel) -> Floats:
    """float64 [D, 2], where doors stand."""
    space = panel.combination.space
    middles = np.zeros((len(space.doors), 2))
    for place, door in enumerate(space.doors):
        source, label = (int(part[0]) for part in np.nonzero(door.edges))
        middles[place] = _middle(panel.lines, source, int(space.target[source, label]))
    return middles


def _middle(lines: EdgeLines, source: int, target: int) -> Floats:
    """float64 [2], of a line of two points, or of many."""
    points = lines.between(source, target)
    middle: Floats = points[len(points) // 2] if len(points) > 2 else points.mean(axis=0)
    return middle


def _how_doors_are(combination: DeclaredCombination, mdp: TabularMDP) -> dict[str, Bools]:
    """Return bool [D] for each way: locked, else as it is in the likelier initial states."""
    names = [door.name for door in combination.space.doors]
    columns = [mdp.variable_names.index(name) for name in names]
    is_open = mdp.initial @ mdp.valuations[:, columns] > 0.5
    locked = np.array([name in combination.environment.locked for name in names], dtype=np.bool_)
    return {"open": is_open & ~locked, "closed": ~is_open & ~locked, "locked": locked}
