"""How long triggers take to see a change, against how often they see one that is not there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from merap.errors import InputError
from merap.report.style import FONT_SIZE, GREEN, INK, LINES, PALE, TITLE_SIZE

_MARKERS = ("o", "s", "^", "D")
_TICKS = (0, 0.1, 1, 10, 100, 1000, 10_000, 100_000)
# The demand: at most one false alarm, and a change is seen within three episodes.
_FALSE_ALARMS, _EPISODES = 1.0, 3.0

Curve = Sequence[tuple[float, float]]


def draw_delays(curves: Mapping[str, Curve], title: str) -> Figure:
    """Draw a curve for each trigger, over its thresholds.

    Args:
        curves: of each trigger, pairs of false alarms in 10^5 steps and mean delay in episodes.
        title: of the picture.

    Raises:
        InputError: no curves, or one without points.
    """
    if not curves or not all(len(curve) for curve in curves.values()):
        raise InputError("there are no curves to draw, or one has no points")
    figure = Figure(figsize=(7.6, 4.4), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for (name, curve), line, marker in zip(curves.items(), cycle(LINES), cycle(_MARKERS), strict=False):
        points = np.array(sorted(curve))
        axes.plot(
            points[:, 0],
            points[:, 1],
            color=line.colour,
            linestyle=line.style,
            linewidth=2.2,
            marker=marker,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.7,
            label=name,
            gid="curve",
        )
    _set_axes(axes, max(delay for curve in curves.values() for _, delay in curve))
    axes.set_title(title, fontsize=TITLE_SIZE, fontweight="bold", color=INK, loc="left", parse_math=False)
    legend = figure.legend(loc="outside lower center", ncols=3, fontsize=FONT_SIZE, frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure


def _set_axes(axes: Axes, longest: float) -> None:
    axes.fill_between(
        [0, _FALSE_ALARMS], 0, _EPISODES, color=GREEN, alpha=0.18, linewidth=0, label="wanted", gid="wanted"
    )
    # Linear up to 0.1, so that no false alarm at all has a place.
    axes.set_xscale("symlog", linthresh=0.1, linscale=0.5)
    axes.set_xlim(left=-0.01)
    axes.xaxis.set_major_locator(FixedLocator(_TICKS))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_ylim(0, 1.05 * max(longest, _EPISODES))
    axes.set_xlabel("false alarms in 100,000 steps without a change", fontsize=FONT_SIZE + 1, color=INK)
    axes.set_ylabel("mean delay in episodes", fontsize=FONT_SIZE + 1, color=INK)
    axes.tick_params(labelsize=FONT_SIZE, labelcolor=INK)
    axes.grid(color=PALE, linewidth=0.6, alpha=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
