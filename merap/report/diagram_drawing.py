"""Draw state diagrams on a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, PathPatch
from matplotlib.path import Path

from merap.mdp.model import Floats
from merap.report.diagram_layout import LINE, NOTE_LINE, NOTE_SIZE, TEXT_SIZE, TITLE, Layout, Route, lay_out
from merap.report.diagrams import Diagram
from merap.report.extent import name_sizes
from merap.report.geometry import triangles
from merap.report.style import GREY, INK, PALE, SKY_BLUE

CAPTION = (
    "Arrows: actions, and how likely they lead there; ranges: it depends on the rest of the state. "
    "What no arrow shows stays. Blue: where an episode begins."
)
_WIDEST = 11.0
_PAD = 0.15
_CORNER, _HEAD = 0.07, 0.09
_CAPTION = 0.25


@dataclass(frozen=True, eq=False)
class Block:
    """Diagrams in rows, as wide as a page, under a caption.

    Attributes:
        layouts: the diagrams.
        corners: float64 [diagrams, 2], the upper left corner of each, from that of the block.
        size: float64 [2], width and height in inches.
    """

    layouts: tuple[Layout, ...]
    corners: Floats
    size: Floats


def diagram_block(diagrams: Sequence[Diagram]) -> Block:
    """Put diagrams beside each other in rows; of none the block is empty."""
    if not diagrams:
        return Block((), np.zeros((0, 2)), np.zeros(2))
    layouts = tuple(lay_out(diagram) for diagram in diagrams)
    corners, row_height, x, y = [], 0.0, 0.0, -_CAPTION
    widest = float(name_sizes((CAPTION,), NOTE_SIZE)[0, 0])
    for layout in layouts:
        width, height = layout.size
        if x > 0 and x + width > _WIDEST:
            x, y, row_height = 0.0, y - row_height - _PAD, 0.0
        corners.append((x, y))
        x, row_height = x + width + _PAD, max(row_height, height)
        widest = max(widest, x - _PAD)
    return Block(layouts, np.array(corners), np.array([widest, row_height - y]))


def draw_block(figure: Figure, block: Block, origin: Floats) -> None:
    """Draw diagrams under a caption.

    Args:
        figure: has its final size.
        block: what is drawn; nothing of an empty one.
        origin: float64 [2], its upper left corner, in inches from the lower left of the page.
    """
    if not block.layouts:
        return
    page = figure.get_size_inches()
    x, y = origin / page
    figure.text(x, y, CAPTION, fontsize=NOTE_SIZE, color=INK, verticalalignment="top")
    for layout, corner in zip(block.layouts, block.corners, strict=True):
        low = origin + corner - np.array([0.0, layout.size[1]])
        axes = figure.add_axes((*(low / page), *(layout.size / page)))
        axes.set_xlim(0, layout.size[0])
        axes.set_ylim(0, layout.size[1])
        axes.set_axis_off()
        axes.set_gid("diagram")
        _draw(axes, layout)


def _draw(axes: Axes, layout: Layout) -> None:
    axes.text(
        0,
        layout.size[1] - TITLE / 2,
        layout.diagram.title,
        fontsize=TEXT_SIZE,
        fontweight="bold",
        color=INK,
        verticalalignment="center",
        parse_math=False,
    )
    for route in layout.routes:
        _draw_route(axes, route)
    for node, centre, box, notes in zip(
        layout.diagram.nodes, layout.centres, layout.boxes, layout.notes, strict=True
    ):
        axes.add_patch(
            FancyBboxPatch(
                (centre[0] - box[0] / 2 + 0.05, centre[1] - box[1] / 2 + 0.05),
                box[0] - 0.1,
                box[1] - 0.1,
                boxstyle="round,pad=0.05",
                facecolor=SKY_BLUE if node.initial else PALE,
                edgecolor=INK,
                linewidth=0.8,
                zorder=3,
                gid="node",
            )
        )
        top = centre[1] + (LINE + NOTE_LINE * len(notes)) / 2
        _write(axes, centre[0], top - LINE / 2, node.text, TEXT_SIZE)
        for line, note in enumerate(notes):
            _write(axes, centre[0], top - LINE - NOTE_LINE * (line + 0.5), note, NOTE_SIZE)


def _draw_route(axes: Axes, route: Route) -> None:
    axes.add_patch(
        PathPatch(
            _rounded(route.points), facecolor="none", edgecolor=GREY, linewidth=1.1, zorder=1, gid="arrow"
        )
    )
    last = route.points[-1]
    down = np.array([[0.0, np.sign(last[1] - route.points[-2, 1])]])
    heads = triangles(last[None] - 0.6 * _HEAD * down, down, _HEAD)
    axes.add_collection(PolyCollection(list(heads), facecolors=GREY, zorder=2))
    top = route.centre[1] + NOTE_LINE * (len(route.lines) - 1) / 2
    for line, text in enumerate(route.lines):
        _write(axes, route.centre[0], top - NOTE_LINE * line, text, NOTE_SIZE)


def _write(axes: Axes, x: float, y: float, text: str, size: float) -> None:
    axes.text(
        x,
        y,
        text,
        fontsize=size,
        color=INK,
        horizontalalignment="center",
        verticalalignment="center_baseline",
        parse_math=False,
        zorder=4,
    )


def _rounded(points: Floats) -> Path:
    """Return the line through points [4, 2] with round corners."""
    start, first, second, end = points
    along = np.sign(second - first) * min(_CORNER, abs(second[0] - first[0]) / 2)
    rise = np.sign(first - start) * _CORNER
    vertices = [start, first - rise, first, first + along, second - along, second, second - rise, end]
    corner = (Path.LINETO, Path.CURVE3, Path.CURVE3)
    return Path(np.array(vertices), [Path.MOVETO, *corner, *corner, Path.LINETO])
