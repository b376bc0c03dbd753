"""Draw the values of properties over the values of a constant, as PRISM's experiments do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from merap.errors import InputError
from merap.report.style import FONT_SIZE, INK, LINES, PALE, TITLE_SIZE

MOST_LINES = 24


def draw_experiment(lines: Mapping[str, Sequence[tuple[float, float]]], constant: str, title: str) -> Figure:
    """Draw one line for each property and choice of the other constants.

    Args:
        lines: name of a line -> pairs of a value of the constant and the property's value there.
        constant: name of the constant.
        title: title of the picture.

    Raises:
        InputError: there is no line, or more than 24.
    """
    if not 0 < len(lines) <= MOST_LINES:
        raise InputError(f"{len(lines)} lines to draw, expected 1 to {MOST_LINES}")
    figure = Figure(figsize=(7.6, 4.4), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for (name, points), line in zip(lines.items(), cycle(LINES), strict=False):
        places, values = zip(*points, strict=True)
        axes.plot(
            places,
            values,
            color=line.colour,
            linestyle=line.style,
            linewidth=2.0,
            marker="o",
            markersize=4,
            label=name,
        )
    axes.set_xlabel(constant, fontsize=FONT_SIZE + 1, color=INK)
    axes.set_ylabel("value", fontsize=FONT_SIZE + 1, color=INK)
    axes.set_title(title, fontsize=TITLE_SIZE, fontweight="bold", color=INK, loc="left", parse_math=False)
    axes.grid(color=PALE, linewidth=0.6, alpha=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    legend = figure.legend(loc="outside lower center", fontsize=FONT_SIZE, frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure
