"""Draw paths on a map, side by side where they share their way."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, pairwise

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D

from merap.mdp.model import Floats
from merap.report.geometry import directions_of, offset_line, right_of, triangles
from merap.report.path import Ending, RoutePath
from merap.report.sheet import Panel
from merap.report.style import INK, Entry, Line, heading, mark

_WIDTH = 2.6
_GAP_ON_GRID = 0.34
_GAP_ON_GRAPH = 0.6
# Radius of a location in points, on a grid and on a graph, down to which lines and marks keep their size.
_USUAL_RADIUS = {True: 18.0, False: 10.0}
_OUTCOMES: dict[Ending, str] = {
    "completed": "completed in {}",
    "ended": "ended in {}, not completed",
    "loop": "not completed, stuck in a loop",
    "open": "not completed in {}",
}


def draw_routes(
    panel: Panel, paths: Sequence[tuple[RoutePath, Line]], *, beside: bool = False
) -> list[Entry]:
    """Draw each path as a line with arrow heads, next to each other where they share an edge.

    With `beside` they leave the middle of the edges to other drawings there.

    A dot ends a path that completed its task, a cross one that did not; a diamond stands where
    an innate action was taken.
    """
    entries = [heading("Paths")]
    gap = (_GAP_ON_GRID if panel.extent.is_grid else _GAP_ON_GRAPH) * panel.extent.radius
    # Symmetric about the edge; where some edge is used both ways, all keep to the right.
    middle = (len(paths) - 1) / 2
    if beside or _oppose([path for path, _ in paths]):
        middle = -1.0 if beside else -0.5
    for index, (path, line) in enumerate(paths):
        side = (index - middle) * gap
        end = _draw_way(panel, path, line, side)
        panel.axes.add_line(_end_mark(path, line.colour, end, _scale(panel)))
        entries.append(_entry(path, line))
    entries += _draw_innate(panel, [path for path, _ in paths])
    return entries


def _oppose(paths: Sequence[RoutePath]) -> bool:
    """Whether they take some edge both ways."""
    hops = {hop for path in paths for hop in pairwise(path.places)}
    return any(here != there and (there, here) in hops for here, there in hops)


def _scale(panel: Panel) -> float:
    """Return the size of lines and marks, so that they leave the goal to be seen on small cells."""
    return min(1.0, panel.extent.radius_in_points / _USUAL_RADIUS[panel.extent.is_grid])


def _draw_way(panel: Panel, path: RoutePath, line: Line, side: float) -> Floats:
    """Draw line and arrow heads; the point where they end."""
    index = panel.combination.space.location_index
    visited = [index[place] for place, _ in groupby(path.places)]
    if len(visited) == 1:
        alone: Floats = panel.combination.space.positions[visited[0]] + np.array([side, 0.0])
        return alone
    points, middle = panel.lines.along(visited)
    moved: Floats = offset_line(points, side)
    width = _WIDTH * _scale(panel)
    panel.axes.plot(*moved.T, color="white", linewidth=1.8 * width, solid_joinstyle="round", zorder=5.5)
    panel.axes.plot(
        *moved.T,
        color=line.colour,
        linestyle=line.style,
        linewidth=width,
        solid_joinstyle="round",
        solid_capstyle="round",
        zorder=6,
        gid=path.label,
    )
    directions = directions_of(points)[middle]
    centres = (points[middle] + points[middle + 1]) / 2 + side * right_of(directions)
    size = (0.5 if panel.extent.is_grid else 1.0) * panel.extent.radius
    heads = triangles(centres, directions, size)
    panel.axes.add_collection(
        PolyCollection(
            list(heads), facecolors=line.colour, edgecolors="white", linewidths=0.25 * width, zorder=6.5
        )
    )
    end: Floats = moved[-1]
    return end


def _end_mark(path: RoutePath, colour: str, place: Floats | None = None, scale: float = 1.0) -> Line2D:
    """Return a dot or a cross; without a place, for the legend."""
    return Line2D(
        [] if place is None else place[:1],
        [] if place is None else place[1:],
        linestyle="none",
        marker="o" if path.completed else "X",
        markersize=scale * (8 if path.completed else 10),
        markerfacecolor=colour,
        markeredgecolor="white",
        markeredgewidth=1.2 * scale,
        zorder=8,
        gid="end of path",
    )


def _entry(path: RoutePath, line: Line) -> Entry:
    shown = Line2D([], [], color=line.colour, linestyle=line.style, linewidth=_WIDTH)
    steps = "1 step" if len(path.actions) == 1 else f"{len(path.actions)} steps"
    return (shown, _end_mark(path, line.colour)), f"{path.label}: {_OUTCOMES[path.ending].format(steps)}"


def _draw_innate(panel: Panel, paths: Sequence[RoutePath]) -> list[Entry]:
    combination = panel.combination
    innate = set(combination.actions) - {action.name for action in combination.capability.external}
    steps = [step for path in paths for step in zip(path.places, path.actions, strict=False)]
    taken = [(place, action) for place, action in steps if action in innate]
    if not taken:
        return []
    index = combination.space.location_index
    points = combination.space.positions[sorted({index[place] for place, _ in taken})]
    size = panel.extent.radius_in_points * (0.37 if panel.extent.is_grid else 0.74)
    panel.axes.plot(
        points[:, 0],
        points[:, 1],
        linestyle="none",
        marker="D",
        markersize=size,
        markerfacecolor="white",
        markeredgecolor=INK,
        zorder=7,
        gid="innate actions",
    )
    names = ", ".join(action for action in combination.actions if action in {name for _, name in taken})
    return [((mark("D", "white", edge=INK, size=0.6),), f"innate: {names}")]
