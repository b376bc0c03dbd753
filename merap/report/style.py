"""Colours, marks and sizes of the pictures.

The palette is that of Okabe and Ito (2008), which people with any kind of colour vision tell
apart; what a colour says, a mark or a line style says too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.text import Text

ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
INK = "#222222"
GREY = "#8C8C8C"
PALE = "#D9D9D9"
WALL = "#4D4D4D"


@dataclass(frozen=True)
class Line:
    """How a line looks: its colour, and its dashes as matplotlib has them, in widths."""

    colour: str
    style: Literal["solid"] | tuple[float, tuple[float, ...]]


LINES = (
    Line(BLUE, "solid"),
    Line(VERMILLION, (0, (3.2, 1.2))),
    Line(GREEN, (0, (1, 0.9))),
    Line(PURPLE, (0, (4, 1, 1, 1))),
)

FONT_SIZE = 9.0
TITLE_SIZE = 12.0
LEGEND_MARK = 11.0

# A legend's line: what it shows (several artists on top of each other) and what it means.
Entry: TypeAlias = tuple[tuple[Artist, ...], str]


def heading(text: str) -> Entry:
    """Return a line of the legend that opens a section."""
    return (), text


def mark(
    marker: str, colour: str, *, edge: str | None = None, size: float = 1.0, width: float = 1.0
) -> Line2D:
    """Return a mark for the legend, `size` times as large as usual."""
    return Line2D(
        [],
        [],
        linestyle="none",
        marker=marker,
        color=colour,
        markeredgecolor=edge or colour,
        markersize=LEGEND_MARK * size,
        markeredgewidth=width,
    )


def unique(entries: Sequence[Entry]) -> list[Entry]:
    """Return the entries without those whose meaning came before."""
    first: dict[str, Entry] = {}
    for entry in entries:
        first.setdefault(entry[1], entry)
    return list(first.values())


def write(
    axes: Axes, x: float, y: float, text: str, *, size: float = FONT_SIZE, weight: str = "normal"
) -> Text:
    """Write centred text with a white rim, on top of everything; no character of it is a command."""
    return axes.text(
        x,
        y,
        text,
        fontsize=size,
        fontweight=weight,
        color=INK,
        horizontalalignment="center",
        verticalalignment="center_baseline",
        parse_math=False,
        zorder=9,
        path_effects=[withStroke(linewidth=2.4, foreground="white")],
    )
