"""The timeline of a loop: return and optimum of each episode, and its events.

Axes: E episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from merap.mapek.records import EpisodeRow
from merap.mapek.scores import LoopReport, Reaction
from merap.mdp.model import Floats
from merap.report.style import (
    BLUE,
    FONT_SIZE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    SKY_BLUE,
    TITLE_SIZE,
    VERMILLION,
)


def draw_timeline(report: LoopReport) -> Figure:
    """Draw return and optimum of every episode, changes, re-plannings, and faults.

    Args:
        report: report of a loop; it has at least one episode.
    """
    figure = Figure(figsize=(9.0, 4.6), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _draw_phases(axes, report.rows)
    _draw_values(axes, report.rows)
    _draw_events(axes, report.rows)
    _draw_changes(axes, report.reactions, report.rows)
    title = f"{report.case}: {report.scenario}, managed by {report.manager}"
    axes.set_title(title, fontsize=TITLE_SIZE, fontweight="bold", color=INK, loc="left", pad=18)
    axes.set_xlim(-0.5, len(report.rows) - 0.5)
    axes.set_xlabel("episode", fontsize=FONT_SIZE + 1, color=INK)
    axes.set_ylabel("return", fontsize=FONT_SIZE + 1, color=INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.tick_params(labelsize=FONT_SIZE, labelcolor=INK)
    axes.grid(color=PALE, linewidth=0.6, alpha=0.7, axis="y")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=FONT_SIZE, frameon=False)
    return figure


def _draw_phases(axes: Axes, rows: Sequence[EpisodeRow]) -> None:
    """Draw a band over the episodes in which the policy was adapted."""
    label: str | None = "policy is adapted"
    for adapting, group in groupby(rows, lambda row: row.phase == "adapting" or row.replans > 0):
        episodes = [row.episode for row in group]
        if adapting:
            axes.axvspan(
                episodes[0] - 0.5,
                episodes[-1] + 0.5,
                facecolor=SKY_BLUE,
                alpha=0.16,
                edgecolor="none",
                label=label,
                gid="adapting",
            )
            label = None


def _draw_values(axes: Axes, rows: Sequence[EpisodeRow]) -> None:
    episodes = np.array([row.episode for row in rows])
    edges = np.append(episodes - 0.5, episodes[-1] + 0.5)
    if any(row.optimum is not None for row in rows):
        _draw_known(axes, rows, edges)
    axes.plot(
        episodes, [row.earned for row in rows], color=BLUE, linewidth=0.9, marker="o", markersize=3.5,
        label="return", gid="return",
    )  # fmt: skip


def _draw_known(axes: Axes, rows: Sequence[EpisodeRow], edges: Floats) -> None:
    """Draw the optimum and the value of the policy, where the ground truth is known."""
    axes.stairs(
        _values([row.optimum for row in rows]), edges, baseline=None, color=INK, linestyle=(0, (4, 4)),
        linewidth=1.2, label="optimum in force", gid="optimum",
    )  # fmt: skip
    if any(row.safe_optimum is not None for row in rows):
        axes.stairs(
            _values([row.possible for row in rows]), edges, baseline=None, color=ORANGE,
            linestyle=(4, (4, 4)), linewidth=1.4, label="optimum within the shield's threshold",
            gid="safe_optimum",
        )  # fmt: skip
    axes.plot(
        [row.episode for row in rows], _values([row.expected for row in rows]), color=GREEN,
        linewidth=1.4, linestyle=(0, (1, 0.9)), label="expected return of the policy", gid="expected",
    )  # fmt: skip


def _values(values: Sequence[float | None]) -> Floats:
    """Return float64 [E]; an unknown value is not drawn."""
    return np.array(values, dtype=np.float64)


def _draw_events(axes: Axes, rows: Sequence[EpisodeRow]) -> None:
    """Draw marks under the curves, one line for each kind of event that there is."""
    kinds = (
        ("re-planning", "^", VERMILLION, [row.episode for row in rows if row.replans]),
        ("violation", "x", PURPLE, [row.episode for row in rows if row.unsafe]),
        (
            "fault or fallback",
            "s",
            ORANGE,
            [row.episode for row in rows if row.problems or row.fallbacks or row.faults],
        ),
    )
    drawn = [value for row in rows for value in (row.earned, row.expected, row.optimum) if value is not None]
    low, high = min(drawn), max(drawn)
    line = 0.07 * max(high - low, 1e-9)
    for label, marker, colour, episodes in kinds:
        if episodes:
            low -= line
            axes.plot(
                episodes, [low] * len(episodes), linestyle="none", marker=marker, markersize=6,
                color=colour, label=label, gid=label,
            )  # fmt: skip
    axes.set_ylim(low - line, high + line)


def _draw_changes(axes: Axes, reactions: Sequence[Reaction], rows: Sequence[EpisodeRow]) -> None:
    """Draw the changes where they came: between episodes, or amid one, at the step."""
    steps = {row.episode: row.steps for row in rows}
    for reaction in reactions:
        moment = reaction.episode - 0.5 + min(1.0, reaction.step / max(1, steps[reaction.episode]))
        axes.axvline(moment, color=GREY, linewidth=1.2, gid="change")
        axes.annotate(
            ", ".join(reaction.changed) or "no change",
            (moment, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=FONT_SIZE,
            color=INK,
        )
