"""Adaptation curves: the value of the policy after each policy update (figure 5 of the paper).

Axes: R runs (seeds), U + 1 rows of a curve; row 0 is before any episode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from merap.errors import InputError
from merap.mdp.model import Floats
from merap.report.style import FONT_SIZE, GREEN, GREY, INK, LINES, PALE, TITLE_SIZE, Line

# A value counts as good if it is below the optimum by at most this part of its amount.
_TOLERANCE = 0.05
_MARKERS = ("o", "s", "^", "D")
_TICKS = (0, 1, 2, 3, 5, 10, 20, 30, 50, 100, 200, 300, 500, 1000, 2000, 5000, 10_000)


Runs: TypeAlias = Sequence[Sequence[float]] | Floats


def draw_adaptation(
    curves: Mapping[str, Runs],
    optimum: float,
    worst: float,
    title: str,
    *,
    scale: Literal["linear", "log"] = "linear",
) -> Figure:
    """Draw the expected return after each policy update.

    One thin line per run, a thick one for their mean, a band from the least to the greatest. A
    run that stopped early keeps its last policy, so its last value goes on.

    Args:
        curves: for each strategy one sequence of expected returns per run.
        optimum: value of the best policy; it and the 5 % below are marked.
        worst: value of the worst policy.
        title: title of the picture.
        scale: scale of the steps; logarithmic ones begin linearly, as they include step 0.

    Raises:
        InputError: no strategy, a strategy without runs, or a run without values.
    """
    if not curves:
        raise InputError("there are no curves to draw")
    tables = {name: _table(name, runs) for name, runs in curves.items()}
    figure = Figure(figsize=(7.6, 4.4), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    last = max(table.shape[1] for table in tables.values()) - 1
    _draw_references(axes, optimum, worst)
    for (name, table), line, marker in zip(tables.items(), cycle(LINES), cycle(_MARKERS), strict=False):
        _draw_strategy(axes, _extended(table, last + 1), name, line, marker)
    lowest = min(table.min() for table in tables.values())
    _set_range(axes, lowest, optimum, worst)
    _set_steps(axes, last, scale)
    axes.set_ylabel("expected return", fontsize=FONT_SIZE + 1, color=INK)
    axes.set_title(title, fontsize=TITLE_SIZE, fontweight="bold", color=INK, loc="left", parse_math=False)
    axes.grid(color=PALE, linewidth=0.6, alpha=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    _add_legend(figure, axes)
    return figure


def _add_legend(figure: Figure, axes: Axes) -> None:
    handles, _ = axes.get_legend_handles_labels()
    runs = (
        Line2D([], [], color=GREY, linewidth=0.7, label="single runs"),
        Patch(facecolor=GREY, alpha=0.3, label="from the least to the greatest"),
    )
    legend = figure.legend(
        handles=[*handles, *runs], loc="outside lower center", ncols=3, fontsize=FONT_SIZE, frameon=False
    )
    for text in legend.get_texts():
        text.set_parse_math(False)


def _table(name: str, runs: Runs) -> Floats:
    """Return float64 [R, U + 1], each run continued with its last value."""
    if len(runs) == 0 or any(len(run) == 0 for run in runs):
        raise InputError(f"strategy {name!r} has no runs, or a run without values")
    longest = max(len(run) for run in runs)
    return np.concatenate([_extended(np.array([run], dtype=np.float64), longest) for run in runs])


def _extended(table: Floats, length: int) -> Floats:
    missing = length - table.shape[1]
    return np.concatenate([table, np.repeat(table[:, -1:], missing, axis=1)], axis=1)


def _draw_references(axes: Axes, optimum: float, worst: float) -> None:
    axes.axhspan(
        optimum - _TOLERANCE * abs(optimum),
        optimum,
        facecolor=GREEN,
        alpha=0.22,
        edgecolor="none",
        label="within 5 %",
        gid="within 5 percent",
    )
    axes.axhline(optimum, color=INK, linestyle="dashed", linewidth=1.2, label=f"optimum {optimum:.4g}")
    axes.axhline(worst, color=GREY, linestyle="dotted", linewidth=1.4, label=f"worst possible {worst:.4g}")


def _draw_strategy(axes: Axes, table: Floats, name: str, line: Line, marker: str) -> None:
    steps = np.arange(table.shape[1])
    axes.fill_between(
        steps, table.min(axis=0), table.max(axis=0), color=line.colour, alpha=0.13, linewidth=0, gid="range"
    )
    for run in table:
        axes.plot(steps, run, color=line.colour, linewidth=0.7, alpha=0.45, gid="run")
    runs = f"mean of {len(table)} runs" if len(table) > 1 else "one run"
    axes.plot(
        steps,
        table.mean(axis=0),
        color=line.colour,
        linestyle=line.style,
        linewidth=2.6,
        marker=marker,
        markersize=5,
        markeredgecolor="white",
        markeredgewidth=0.7,
        label=f"{name} ({runs})",
        gid="mean",
        zorder=4,
    )


def _set_range(axes: Axes, lowest: float, optimum: float, worst: float) -> None:
    """Show from a bit below the curves to a bit above the optimum; the worst value only if it is near."""
    span = max(optimum - lowest, 0.1 * abs(optimum), 1e-9)
    bottom = worst if lowest - worst < 0.4 * span else lowest
    axes.set_ylim(bottom - 0.06 * span, optimum + 0.06 * span)


def _set_steps(axes: Axes, last: int, scale: Literal["linear", "log"]) -> None:
    axes.set_xlim(-0.02 * max(last, 1), 1.02 * max(last, 1))
    axes.set_xlabel("policy update", fontsize=FONT_SIZE + 1, color=INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if scale == "log":
        axes.set_xscale("symlog", linthresh=1, linscale=0.35)
        axes.set_xlim(-0.05, 1.05 * max(last, 1))
        ticks = [tick for tick in _TICKS if tick <= last]
        axes.xaxis.set_major_locator(FixedLocator(ticks))
        axes.xaxis.set_major_formatter("{x:.0f}")
        axes.xaxis.set_minor_locator(NullLocator())
    axes.tick_params(labelsize=FONT_SIZE, labelcolor=INK)
