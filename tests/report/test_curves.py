"""Adaptation curves: the numbers that were given, their mean, least and greatest; and pictures as files."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from merap.errors import InputError, OutputError
from merap.report.curves import draw_adaptation
from merap.report.map import draw_map
from merap.report.saving import figure_bytes, save_figure
from tests.support.hand_made import graph_combination
from tests.support.route_paths import written_path

RUNS = [[-4.0, 2.0, 5.0, 5.9], [-4.0, 0.0, 4.0, 5.7], [-4.0, 1.0, 6.0, 6.0]]


def axes_of(figure: Figure) -> Axes:
    (axes,) = figure.axes
    return axes


def lines(axes: Axes, name: str) -> list[Any]:
    return [line for line in axes.lines if line.get_gid() == name]


def legend_of(figure: Figure) -> list[str]:
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_every_run_and_their_mean_are_drawn() -> None:
    figure = draw_adaptation({"gradient": RUNS}, 6.0, -9.0, "met")
    axes = axes_of(figure)
    assert [line.get_ydata().tolist() for line in lines(axes, "run")] == RUNS
    (mean,) = lines(axes, "mean")
    np.testing.assert_allclose(mean.get_ydata(), [-4, 1, 5, (5.9 + 5.7 + 6) / 3])
    np.testing.assert_array_equal(mean.get_xdata(), [0, 1, 2, 3])
    assert "gradient (mean of 3 runs)" in legend_of(figure)
    assert axes.get_title(loc="left") == "met"


def test_the_band_reaches_from_least_to_greatest() -> None:
    axes = axes_of(draw_adaptation({"gradient": RUNS}, 6.0, -9.0, ""))
    (band,) = [collection for collection in axes.collections if collection.get_gid() == "range"]
    corners = np.asarray(band.get_paths()[0].vertices)
    at_step_1 = corners[corners[:, 0] == 1, 1]
    assert (at_step_1.min(), at_step_1.max()) == (0.0, 2.0)


@pytest.mark.parametrize(("optimum", "least"), [(6.0, 5.7), (-4.0, -4.2), (0.0, 0.0)])
def test_within_5_percent_is_below_the_optimum_by_5_percent_of_its_amount(
    optimum: float, least: float
) -> None:
    axes = axes_of(draw_adaptation({"gradient": [[optimum - 3, optimum]]}, optimum, optimum - 9, ""))
    (band,) = [patch for patch in axes.patches if patch.get_gid() == "within 5 percent"]
    box = band.get_path().get_extents(band.get_patch_transform())
    assert (box.y0, box.y1) == (pytest.approx(least), pytest.approx(optimum))


def test_a_run_that_stopped_early_keeps_its_value() -> None:
    curves = {"gradient": [[0.0, 1.0, 2.0], [4.0]], "pretrained": [[3.0]]}
    axes = axes_of(draw_adaptation(curves, 6.0, -1.0, ""))
    first, second = lines(axes, "mean")
    np.testing.assert_array_equal(first.get_ydata(), [2.0, 2.5, 3.0])
    np.testing.assert_array_equal(second.get_ydata(), [3.0, 3.0, 3.0])


def test_strategies_differ_in_more_than_colour() -> None:
    names = ["gradient", "belief", "ope", "pretrained"]
    axes = axes_of(draw_adaptation(dict.fromkeys(names, RUNS), 6.0, -9.0, ""))
    drawn = lines(axes, "mean")
    assert len({line.get_color() for line in drawn}) == 4
    assert len({line.get_marker() for line in drawn}) == 4
    assert len({str(line.get_linestyle()) + str(line._dash_pattern) for line in drawn}) == 4


def test_the_worst_value_is_shown_only_where_it_does_not_squeeze_the_curves() -> None:
    near = axes_of(draw_adaptation({"gradient": RUNS}, 6.0, -7.0, ""))
    far = draw_adaptation({"gradient": RUNS}, 6.0, -40.0, "")
    assert near.get_ylim()[0] < -7
    assert -5 < axes_of(far).get_ylim()[0] < -4
    assert "worst possible -40" in legend_of(far)


def test_logarithmic_steps_begin_at_0() -> None:
    runs = np.linspace(0, 5, 31)[None]
    axes = axes_of(draw_adaptation({"gradient": runs}, 6.0, -1.0, "", scale="log"))
    assert axes.get_xticks().tolist() == [0, 1, 2, 3, 5, 10, 20, 30]
    at = axes.transData.transform([(step, 0) for step in (0, 1, 10, 20)])[:, 0]
    assert at[0] < at[1]
    # Equal factors are equally far apart: 1 to 10 is log(10) / log(2) times as far as 10 to 20.
    assert (at[2] - at[1]) / (at[3] - at[2]) == pytest.approx(np.log(10) / np.log(2))


def test_titles_are_not_read_as_formulas() -> None:
    figure = draw_adaptation({"a_b$": [[1.0]]}, 6.0, 0.0, "cost $5 and $6")
    assert figure_bytes(figure, ".svg")


@pytest.mark.parametrize("curves", [{}, {"gradient": []}, {"gradient": [[1.0], []]}])
def test_nothing_to_draw_is_an_error(curves: dict[str, list[list[float]]]) -> None:
    with pytest.raises(InputError, match=r"no curves|no runs"):
        draw_adaptation(curves, 6.0, 0.0, "")


def curve() -> Figure:
    return draw_adaptation({"gradient": RUNS}, 6.0, -9.0, "met")


def test_both_formats_are_valid_and_of_one_size(tmp_path: Path) -> None:
    written = save_figure(curve(), tmp_path / "curves" / "b_blocked.speed_low.g1")
    assert [file.name for file in written] == ["b_blocked.speed_low.g1.png", "b_blocked.speed_low.g1.svg"]
    assert sorted(entry.name for entry in (tmp_path / "curves").iterdir()) == [file.name for file in written]
    png = written[0].read_bytes()
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", png[16:24])
    svg = ElementTree.fromstring(written[1].read_bytes())
    assert svg.tag == "{http://www.w3.org/2000/svg}svg"
    # 160 dots per inch against 72 points per inch.
    points_wide, points_high = (float(svg.attrib[name].removesuffix("pt")) for name in ("width", "height"))
    assert (width / 160, height / 160) == pytest.approx((points_wide / 72, points_high / 72), abs=0.01)
    assert b"<dc:date>" not in written[1].read_bytes()


def test_nothing_is_overwritten_silently(tmp_path: Path) -> None:
    figure = curve()
    (tmp_path / "map.svg").write_text("mine")
    for name in ("map", "map.svg"):
        with pytest.raises(OutputError, match=r"map\.svg: exists already"):
            save_figure(figure, tmp_path / name)
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.svg"]
    assert (tmp_path / "map.svg").read_text() == "mine"
    save_figure(figure, tmp_path / "map.svg", force=True)
    assert (tmp_path / "map.svg").read_text().startswith("<?xml")


def test_a_place_or_format_that_can_not_be_written_is_refused(tmp_path: Path) -> None:
    figure = curve()
    with pytest.raises(OutputError, match=r"pdf is not offered; allowed: \.png, \.svg"):
        save_figure(figure, tmp_path / "map.pdf")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="can't be written"):
        save_figure(figure, tmp_path / "file" / "map.svg")


@pytest.mark.parametrize("suffix", [".svg", ".png"])
def test_the_same_picture_has_the_same_bytes(suffix: str) -> None:
    combination = graph_combination()
    path = written_path(combination, [(0, "go"), (1, "start_scan")], 1)
    first, second = (figure_bytes(draw_map(combination, paths=[path]), suffix) for _ in range(2))
    assert first == second
    assert figure_bytes(draw_map(combination), suffix) != first
