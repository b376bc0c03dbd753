"""A page: maps beside or below each other, one legend for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D

from merap.concerns.combination import DeclaredCombination
from merap.mdp.model import Bools, Floats
from merap.report.diagram_drawing import diagram_block, draw_block
from merap.report.diagrams import Diagram
from merap.report.extent import Extent, extent_of
from merap.report.geometry import EdgeLines, edge_lines
from merap.report.style import FONT_SIZE, INK, PALE, TITLE_SIZE, Entry, unique

_NOTHING = Line2D([], [], linestyle="none")

# Inches.
_PAD = 0.2
_TITLE = 0.4
_PANEL_TITLE = 0.32
_TICKS = 0.45
_COLOUR_BAR = np.array([0.16, 1.5])
_COLOUR_BAR_TITLE = 0.3
# A map wider than this, relative to its height, has the next one below it.
_WIDE = 1.3


@dataclass(frozen=True, eq=False)
class Panel:
    """One map of a page.

    Attributes:
        axes: to draw on, in the units of the positions.
        extent: the part of the plane on it, and its scale.
        lines: along which edges run.
        combination: the combination on it.
    """

    axes: Axes
    extent: Extent
    lines: EdgeLines
    combination: DeclaredCombination


@dataclass(frozen=True, eq=False)
class Sheet:
    """A page whose maps have no place yet.

    Attributes:
        figure: the page.
        panels: its maps, all of the same extent.
    """

    figure: Figure
    panels: tuple[Panel, ...]


def open_sheet(combination: DeclaredCombination, panels: int) -> Sheet:
    """Make a page with empty maps of one combination; `close_sheet` gives them their place."""
    extent = extent_of(combination.space)
    # On a grid neighbours touch, nothing lies between them.
    clearance = 0.0 if extent.is_grid else 1.3 * extent.radius
    lines = edge_lines(combination.space, _blocked(combination), clearance)
    figure = Figure(facecolor="white")
    return Sheet(
        figure, tuple(Panel(_add_axes(figure, extent), extent, lines, combination) for _ in range(panels))
    )


def _blocked(combination: DeclaredCombination) -> Bools:
    """bool [P, L], the edges that are blocked; those through locked doors are drawn as doors."""
    environment = combination.environment
    locked = [door.edges for door in combination.space.doors if door.name in environment.locked]
    blocked: Bools = environment.blocked_edges & ~np.logical_or.reduce(
        [np.zeros_like(environment.blocked_edges), *locked]
    )
    return blocked


def _add_axes(figure: Figure, extent: Extent) -> Axes:
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(extent.low[0], extent.high[0])
    axes.set_ylim(extent.low[1], extent.high[1])
    axes.set_xticks([])
    axes.set_yticks([])
    axes.autoscale(enable=False)
    axes.spines[:].set_color(PALE)
    return axes


def close_sheet(
    sheet: Sheet,
    *,
    title: str,
    panel_titles: Sequence[str] = (),
    entries: Sequence[Entry],
    colour_bar: tuple[ScalarMappable, str] | None = None,
    diagrams: Sequence[Diagram] = (),
) -> Figure:
    """Add title, legend and diagrams, and place everything.

    Args:
        sheet: with maps that are drawn.
        title: title of the page.
        panel_titles: one per map, or none.
        entries: entries of the legend; one for each meaning.
        colour_bar: colours and their title.
        diagrams: they come below the maps.
    """
    figure, extent = sheet.figure, sheet.panels[0].extent
    legend, legend_size = _draw_legend(figure, unique(entries))
    if colour_bar:
        legend_size += np.array([0.0, _COLOUR_BAR[1] + _COLOUR_BAR_TITLE + _PAD])
    block = diagram_block(diagrams)
    places = _arrange(extent, len(sheet.panels), bool(panel_titles), legend_size, block.size)
    figure.set_size_inches(*places.page)
    for panel, corner in zip(sheet.panels, places.corners, strict=True):
        panel.axes.set_position((*(corner / places.page), *(extent.inches / places.page)))
    for corner, text in zip(places.corners, panel_titles, strict=False):
        _write(figure, (corner + np.array([0.0, places.above])) / places.page, text, FONT_SIZE + 1)
    _write(figure, places.title / places.page, title, TITLE_SIZE)
    legend.set_bbox_to_anchor(tuple(places.legend / places.page), figure.transFigure)
    if colour_bar:
        corner = places.legend + np.array([0.1, _PAD - legend_size[1]])
        _draw_colour_bar(figure, colour_bar, (*(corner / places.page), *(_COLOUR_BAR / places.page)))
    draw_block(figure, block, places.block)
    return figure


def diagram_page(title: str, diagrams: Sequence[Diagram]) -> Figure:
    """Return a page of diagrams alone."""
    block = diagram_block(diagrams)
    figure = Figure(facecolor="white", figsize=(block.size + 2 * _PAD + np.array([0.0, _TITLE])).tolist())
    page = figure.get_size_inches()
    _write(figure, np.array([_PAD, page[1] - _PAD - 0.7 * _TITLE]) / page, title, TITLE_SIZE)
    draw_block(figure, block, np.array([_PAD, _PAD + block.size[1]]))
    return figure


@dataclass(frozen=True, eq=False)
class _Places:
    """Inches from the lower left corner of the page.

    Attributes:
        page: float64 [2], width and height.
        title: float64 [2], the lower left corner of the title.
        corners: float64 [panels, 2], the lower left corner of each map.
        above: from there to the title of a map.
        legend: float64 [2], the upper left corner of the legend.
        block: float64 [2], the upper left corner of the diagrams.
    """

    page: Floats
    title: Floats
    corners: Floats
    above: float
    legend: Floats
    block: Floats


def _arrange(
    extent: Extent, panels: int, has_titles: bool, legend_size: Floats, block_size: Floats
) -> _Places:
    ticks = _TICKS if extent.is_grid else 0.0
    cell = extent.inches + np.array([ticks, ticks + (_PANEL_TITLE if has_titles else 0.0)])
    below = extent.inches[0] > _WIDE * extent.inches[1]
    step = np.array([0, 1]) if below else np.array([1, 0])
    maps = cell + (panels - 1) * step * (cell + _PAD)
    top = _PAD + _TITLE
    below_all = max(maps[1], legend_size[1]) + top + _PAD
    width = max(maps[0] + legend_size[0] + 3 * _PAD, block_size[0] + 2 * _PAD)
    page = np.array([width, below_all + block_size[1] + (_PAD if block_size[1] else 0.0)])
    shift = np.arange(panels)[:, None] * step * (cell + _PAD)
    corners = np.array([_PAD + ticks, page[1] - top - cell[1]]) + shift * np.array([1, -1])
    legend = np.array([2 * _PAD + maps[0], page[1] - top])
    title = np.array([_PAD, page[1] - _PAD - 0.7 * _TITLE])
    block = np.array([_PAD, page[1] - below_all])
    return _Places(page, title, corners, extent.inches[1] + ticks + 0.08, legend, block)


def _draw_legend(figure: Figure, entries: Sequence[Entry]) -> tuple[Legend, Floats]:
    """Draw the legend; return it and its size, float64 [2] in inches."""
    legend = figure.legend(
        # A tuple of artists is drawn one on top of the other, which the type does not know.
        cast("Any", [artists or (_NOTHING,) for artists, _ in entries]),
        [text if artists or index == 0 else f"\n{text}" for index, (artists, text) in enumerate(entries)],
        loc="upper left",
        fontsize=FONT_SIZE,
        labelcolor=INK,
        frameon=False,
        borderpad=0,
        borderaxespad=0,
        labelspacing=0.75,
        handlelength=2.8,
    )
    for (artists, _), text in zip(entries, legend.get_texts(), strict=True):
        text.set_parse_math(False)
        if not artists:
            text.set_fontweight("bold")
    box = legend.get_window_extent(FigureCanvasAgg(figure).get_renderer())  # type: ignore[no-untyped-call]
    return legend, np.array([box.width, box.height]) / figure.dpi


def _draw_colour_bar(
    figure: Figure, colour_bar: tuple[ScalarMappable, str], place: tuple[float, float, float, float]
) -> None:
    colours, title = colour_bar
    axes = figure.add_axes(place)
    figure.colorbar(colours, cax=axes)
    axes.tick_params(labelsize=FONT_SIZE - 1, labelcolor=INK)
    axes.set_title(title, fontsize=FONT_SIZE, fontweight="bold", color=INK, loc="left", parse_math=False)


def _write(figure: Figure, place: Floats, text: str, size: float) -> None:
    x, y = place
    figure.text(x, y, text, fontsize=size, fontweight="bold", color=INK, parse_math=False)
