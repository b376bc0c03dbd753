"""Draw paths on a map, side by side where they share their way."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D

from merap.concerns.combination import Combination
from merap.mdp.model import Floats
from merap.report.frame import Frame
from merap.report.geometry import EdgeLines, directions_of, offset_line, right_of, triangles
from merap.report.path import RoutePath
from merap.report.style import INK, Entry, Line, heading, mark

_WIDTH = 2.6
_GAP_ON_GRID = 0.34
_GAP_ON_GRAPH = 0.6


def draw_routes(
    axes: Axes,
    frame: Frame,
    lines: EdgeLines,
    combination: Combination,
    paths: Sequence[tuple[RoutePath, Line]],
) -> list[Entry]:
    """Each path as a line with arrow heads, next to each other where they share an edge.

    A dot ends a path that completed its task, a cross one that did not; a diamond stands where
    an innate action was taken.
    """
    entries = [heading("Paths")]
    gap = (_GAP_ON_GRID if frame.is_grid else _GAP_ON_GRAPH) * frame.radius
    # Symmetric about the edge, unless some edge is used both ways: then all keep to the right.
    middle = -0.5 if _oppose([path for path, _ in paths]) else (len(paths) - 1) / 2
    for index, (path, line) in enumerate(paths):
        side = (index - middle) * gap
        end = _draw_way(axes, frame, lines, path, line, side)
        axes.plot(*end, **_end_mark(path, line.colour), zorder=8, gid="end of path")
        entries.append(_entry(path, line))
    entries += _draw_innate(axes, frame, combination, [path for path, _ in paths])
    return entries


def _oppose(paths: Sequence[RoutePath]) -> bool:
    """Whether they take some edge both ways."""
    hops = {hop for path in paths for hop in pairwise(path.locations)}
    return any(here != there and (there, here) in hops for here, there in hops)


def _draw_way(
    axes: Axes,
    frame: Frame,
    lines: EdgeLines,
    path: RoutePath,
    line: Line,
    side: float,
) -> Floats:
    """Draw line and arrow heads; the point where they end."""
    visited = [path.locations[0], *(there for here, there in pairwise(path.locations) if here != there)]
    if len(visited) == 1:
        return lines.positions[visited[0]]
    points, middle = lines.along(visited)
    moved = offset_line(points, side)
    axes.plot(*moved.T, color="white", linewidth=_WIDTH + 2, solid_joinstyle="round", zorder=5.5)
    axes.plot(
        *moved.T,
        color=line.colour,
        linestyle=line.style,
        linewidth=_WIDTH,
        solid_joinstyle="round",
        solid_capstyle="round",
        zorder=6,
        gid=path.label,
    )
    directions = directions_of(points)[middle]
    centres = (points[middle] + points[middle + 1]) / 2 + side * right_of(directions)
    size = (0.5 if frame.is_grid else 1.0) * frame.radius
    heads = triangles(centres, directions, size)
    axes.add_collection(
        PolyCollection(list(heads), facecolors=line.colour, edgecolors="white", linewidths=0.6, zorder=6.5)
    )
    return moved[-1]


def _end_mark(path: RoutePath, colour: str) -> dict[str, object]:
    return {
        "linestyle": "none",
        "marker": "o" if path.completed else "X",
        "markersize": 8 if path.completed else 10,
        "markerfacecolor": colour,
        "markeredgecolor": "white",
        "markeredgewidth": 1.2,
    }


def _entry(path: RoutePath, line: Line) -> Entry:
    shown = Line2D([], [], color=line.colour, linestyle=line.style, linewidth=_WIDTH)
    steps = len(path.actions)
    outcome = f"completed in {steps} steps" if path.completed else f"not completed, {steps} steps"
    return (shown, Line2D([], [], **_end_mark(path, line.colour))), f"{path.label}: {outcome}"


def _draw_innate(
    axes: Axes, frame: Frame, combination: Combination, paths: Sequence[RoutePath]
) -> list[Entry]:
    external = {action.name for action in combination.capability.external}
    taken = sorted(
        {
            (location, action)
            for path in paths
            for location, action in zip(path.locations, path.actions, strict=False)
            if action not in external
        }
    )
    if not taken:
        return []
    points = combination.space.positions[sorted({location for location, _ in taken})]
    size = 0.62 * frame.radius_in_points * (1 if frame.is_grid else 2)
    axes.plot(
        points[:, 0],
        points[:, 1],
        linestyle="none",
        marker="D",
        markersize=size * 0.6,
        markerfacecolor="white",
        markeredgecolor=INK,
        zorder=7,
        gid="innate actions",
    )
    names = ", ".join(action for action in combination.actions if action in {name for _, name in taken})
    return [((mark("D", "white", edge=INK, size=0.6),), f"innate: {names}")]
