"""How a path ends: completed, or ended elsewhere; and a mark that leaves the goal to be seen."""

from __future__ import annotations

import pytest
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from merap.concerns.combination import DeclaredCombination
from merap.concerns.lookup import declared
from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.evaluation import as_policy
from merap.report.map import draw_map
from merap.report.path import RoutePath, most_likely_path
from tests.support.hand_made import grid_combination
from tests.support.paths import MODELS
from tests.support.route_paths import written_path


def line(axes: Axes, name: str) -> Line2D:
    (found,) = [one for one in axes.get_lines() if one.get_gid() == name]
    return found


def along(combination: DeclaredCombination) -> RoutePath:
    """Along the diagonal of a grid, to the goal in its last corner."""
    side = combination.space.shape[1] if combination.space.shape else 0
    steps = [
        (place * side + place + part, ("down", "right")[1 - part])
        for place in range(side - 1)
        for part in (0, 1)
    ]
    return written_path(combination, steps, side * side - 1, "completed")


def test_a_hole_ends_the_task_and_does_not_complete_it() -> None:
    """On dry ice [1, 1] is a hole."""
    lake = declared(load_case(MODELS / "frozen-lake").combination("broken_r1c1_r1c3_r2c3_r3c0.dry.corner"))
    model = explored(lake)
    down, right = (model.action_names.index(name) for name in ("down", "right"))
    into_the_hole = as_policy(model, (model.valuations[:, 0] == 0) * (down - right) + right)
    path = most_likely_path(model, lake, into_the_hole, 100)
    assert path.text == "r0c0 -down-> r1c0 -right-> r1c1 (ended)"
    assert not path.completed
    figure = draw_map(lake, paths=[path])
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "path: ended in 2 steps, not completed" in texts
    assert line(figure.axes[0], "end of path").get_marker() == "X"


@pytest.mark.parametrize("size", [3, 9, 30, 80])
def test_the_end_leaves_the_goal_to_be_seen(size: int) -> None:
    """Its mark is at most half as wide as the goal's star, and the line a quarter."""
    combination = grid_combination(size=size, goal=(size - 1, size - 1))
    axes = draw_map(combination, paths=[along(combination)]).axes[0]
    star = next(one for one in axes.get_lines() if one.get_gid() == "goal")
    end, way = line(axes, "end of path"), line(axes, "path")
    assert end.get_markersize() <= star.get_markersize() / 2
    assert way.get_linewidth() <= star.get_markersize() / 4
