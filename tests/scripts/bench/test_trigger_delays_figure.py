"""The picture of delay against false alarms: the numbers that were given."""

from __future__ import annotations

import numpy as np
import pytest

from merap.errors import InputError
from merap.report.saving import figure_bytes
from scripts.bench.trigger_delays_figure import draw_delays

CURVES = {"change": [(0.0, 1.4), (70.0, 1.0)], "window_a$": [(4000.0, 1.0), (0.1, 25.0), (30.0, 1.3)]}


def test_every_threshold_is_a_point_of_its_curve() -> None:
    figure = draw_delays(CURVES, "cost $5")
    (axes,) = figure.axes
    first, second = (line for line in axes.lines if line.get_gid() == "curve")
    assert np.asarray(first.get_xydata()).tolist() == [[0.0, 1.4], [70.0, 1.0]]
    assert np.asarray(second.get_xydata()).tolist() == [[0.1, 25.0], [30.0, 1.3], [4000.0, 1.0]]
    assert first.get_marker() != second.get_marker()
    assert axes.get_ylim()[1] > 25
    assert figure_bytes(figure, ".svg")


def test_what_is_wanted_is_marked() -> None:
    figure = draw_delays(CURVES, "")
    (axes,) = figure.axes
    (wanted,) = [collection for collection in axes.collections if collection.get_gid() == "wanted"]
    box = wanted.get_paths()[0].get_extents()
    assert (box.x0, box.x1, box.y0, box.y1) == (0, 1, 0, 3)
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} == {"change", "window_a$", "wanted"}


@pytest.mark.parametrize("curves", [{}, {"change": []}])
def test_nothing_to_draw_is_an_error(curves: dict[str, list[tuple[float, float]]]) -> None:
    with pytest.raises(InputError, match="no curves to draw"):
        draw_delays(curves, "")
