"""Draw the edges of a map."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection

from merap.mdp.model import Bools, Floats
from merap.report.geometry import EdgeLines, directions_of, right_of, triangles
from merap.report.sheet import Panel
from merap.report.style import GREY, VERMILLION, Entry, mark


def draw_edges(panel: Panel) -> list[Entry]:
    """Draw edges as lines, one-way ones with an arrow head, blocked ones dotted with a bar across.

    On a grid neighbours touch, so that only the bars are drawn.
    """
    extent, blocked = panel.extent, panel.lines.any_blocked
    entries: list[Entry] = []
    if not extent.is_grid:
        _draw_lines(panel)
        entries += _draw_directions(panel)
    if blocked.any():
        half = extent.spacing / 2 if extent.is_grid else 1.1 * extent.radius
        middles, directions = _middles(panel.lines, blocked)
        across = half * right_of(directions)
        bars = np.stack([middles - across, middles + across], axis=1)
        panel.axes.add_collection(
            LineCollection(list(bars), colors=VERMILLION, linewidths=4, zorder=4, gid="blocked edges")
        )
        entries.append(((mark("|", VERMILLION, width=4),), "blocked edge"))
    return entries


def _draw_lines(panel: Panel) -> None:
    lines = panel.lines
    closed = lines.any_blocked & ~lines.forward[:, 1] & ~lines.backward[:, 1]
    for mask, style, colour in ((~closed, "solid", GREY), (closed, "dotted", VERMILLION)):
        chosen = [line for line, wanted in zip(lines.lines, mask, strict=True) if wanted]
        if chosen:
            panel.axes.add_collection(
                LineCollection(chosen, colors=colour, linestyles=style, linewidths=1.6, zorder=1, gid="edges")
            )


def _draw_directions(panel: Panel) -> list[Entry]:
    lines, radius = panel.lines, panel.extent.radius
    one_way = lines.forward[:, 1] != lines.backward[:, 1]
    if not one_way.any():
        return []
    middles, directions = _middles(lines, one_way)
    directions = np.where(lines.forward[one_way, 1, None], directions, -directions)
    # In the middle there is a bar if the other direction is blocked.
    shift = np.where(lines.any_blocked[one_way], 1.3 * radius, 0)
    heads = triangles(middles + directions * shift[:, None], directions, 0.9 * radius)
    panel.axes.add_collection(PolyCollection(list(heads), facecolors=GREY, zorder=1, gid="one-way edges"))
    return [((mark(">", GREY, size=0.7),), "one-way edge")]


def _middles(lines: EdgeLines, mask: Bools) -> tuple[Floats, Floats]:
    """Return float64 [M, 2] twice: the middle of each masked line and its direction there."""
    chosen = [line for line, wanted in zip(lines.lines, mask, strict=True) if wanted]
    pieces = np.array([line[(len(line) - 1) // 2 : (len(line) - 1) // 2 + 2] for line in chosen])
    ends = np.array([[line[0], line[-1]] for line in chosen])
    # The middle piece of a bent line begins at its middle point, a straight one has one piece.
    straight = np.array([len(line) == 2 for line in chosen])[:, None]
    middles = np.where(straight, ends.mean(axis=1), pieces[:, 0])
    return middles, np.concatenate([directions_of(piece) for piece in pieces])
