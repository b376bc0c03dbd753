from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.patches import StepPatch

from merap.mapek.scores import LoopReport, Reaction
from merap.report.saving import figure_bytes
from merap.report.timeline import draw_timeline
from tests.support.loop_examples import episode_row as row

ROWS = (
    row(0, 0, 6.0, earned=5.0, phase="adapting"),
    row(1, 0, 6.0, earned=6.0),
    row(2, 1, -9.0, earned=-9.0, optimum=8.0, entered=-9.0, replans=1, unsafe=2),
    row(3, 1, 8.0, earned=7.0, optimum=8.0, phase="adapting"),
    row(4, 1, 8.0, earned=8.0, optimum=8.0, problems=1),
)
REPORT = LoopReport(
    "small", "merap", "grid", 0, ROWS, (Reaction(2, ("environment",), 2, 2, 20, 18.0),), None, (0.1,) * 5
)


@pytest.fixture(scope="module")
def axes() -> Axes:
    return draw_timeline(REPORT).axes[0]


def line(axes: Axes, name: str) -> tuple[list[float], list[float]]:
    found = next(one for one in axes.get_lines() if one.get_gid() == name)
    return np.asarray(found.get_xdata()).tolist(), np.asarray(found.get_ydata()).tolist()


def test_the_title_names_case_scenario_and_manager(axes: Axes) -> None:
    assert axes.get_title(loc="left") == "grid: small, managed by merap"


def test_returns_and_values_stand_at_their_episodes(axes: Axes) -> None:
    assert line(axes, "return") == ([0, 1, 2, 3, 4], [5, 6, -9, 7, 8])
    assert line(axes, "expected") == ([0, 1, 2, 3, 4], [6, 6, -9, 8, 8])


def test_the_optimum_is_a_staircase_between_episodes(axes: Axes) -> None:
    steps = next(patch for patch in axes.patches if isinstance(patch, StepPatch))
    values, edges, _ = steps.get_data()
    assert np.asarray(values).tolist() == [6, 6, 8, 8, 8]
    assert np.asarray(edges).tolist() == [-0.5, 0.5, 1.5, 2.5, 3.5, 4.5]


def test_events_are_marked_under_the_curves_on_lines_of_their_own(axes: Axes) -> None:
    marks = [line(axes, name) for name in ("re-planning", "violation", "fault or fallback")]
    assert [where for where, _ in marks] == [[2], [2], [4]]
    heights = [height for _, (height,) in marks]
    assert -9 > heights[0] > heights[1] > heights[2] > axes.get_ylim()[0]


def test_a_change_stands_before_its_episode_with_the_concern(axes: Axes) -> None:
    assert line(axes, "change")[0] == [1.5, 1.5]
    assert "environment" in [text.get_text() for text in axes.texts]


def test_a_change_amid_an_episode_stands_inside_of_it() -> None:
    """Five of 20 steps: a quarter of the way from 1.5 to 2.5."""
    rows = [replace(one, steps=20) for one in ROWS]
    amid = replace(REPORT, rows=tuple(rows), reactions=(replace(REPORT.reactions[0], step=5),))
    assert line(draw_timeline(amid).axes[0], "change")[0] == [1.75, 1.75]


def test_bands_are_where_the_policy_was_adapted(axes: Axes) -> None:
    bands = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches
             if patch.get_gid() == "adapting"]  # fmt: skip
    assert [(round(band.x0, 6), round(band.x1, 6)) for band in bands] == [(-0.5, 0.5), (1.5, 3.5)]


def test_a_quiet_run_has_no_marks() -> None:
    quiet = draw_timeline(replace(REPORT, rows=ROWS[:2], reactions=(), seconds=(0.1,) * 2)).axes[0]
    assert {one.get_gid() for one in quiet.get_lines()} == {"return", "expected"}


def test_the_same_run_is_the_same_picture() -> None:
    assert figure_bytes(draw_timeline(REPORT), ".svg") == figure_bytes(draw_timeline(REPORT), ".svg")


def test_what_nobody_knows_is_not_drawn() -> None:
    rows = tuple(
        replace(one, optimum=None, discounted_optimum=None, expected=None, unsafe=None) for one in ROWS[:2]
    )
    (drawn,) = draw_timeline(replace(REPORT, rows=rows, reactions=())).axes
    assert line(drawn, "return") == ([0, 1], [5, 6])
    assert {one.get_gid() for one in drawn.get_lines()} == {"return"}
    assert not any(isinstance(patch, StepPatch) for patch in drawn.patches)
