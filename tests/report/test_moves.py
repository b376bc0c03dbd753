"""Policies on maps: arrows where they lead, one set for each mode that can move."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.concerns.combination import DeclaredCombination
from merap.concerns.lookup import declared
from merap.errors import ModelError
from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.model import Floats, TabularMDP
from merap.report.map import draw_map
from merap.report.moves import likeliest_moves
from tests.support.drawings import legend_of, named, only, polygons
from tests.support.hand_made import cells, grid_combination
from tests.support.paths import ROOT

ROOMS = """\
case: rooms
space:
  locations: {left: [0, 0], right: [4, 0]}
  edges: [[left, right, east], [right, left, west]]
  doors: {door: {between: [left, right], changes: [{set: [{value: "!door", probability: 0.5}, {otherwise: door}]}]}}
environment: {}
capability: {actions: {stop: {}, east: {move: east}, west: {move: west}}}
objective: {start: left, horizon: 9, rewards: [{value: 1}]}
"""  # noqa: E501


@pytest.fixture(scope="module")
def building() -> DeclaredCombination:
    """26 named locations; A is blocked."""
    return declared(load_case(ROOT / "models" / "running-example").system("met"))


def rows_of(mdp: TabularMDP, **chances: float) -> Floats:
    """The same choice in every state."""
    policy = np.zeros((mdp.num_states, mdp.num_actions))
    for name, chance in chances.items():
        policy[:, mdp.action_names.index(name)] = chance
    return policy


def test_a_policy_is_an_arrow_per_location() -> None:
    combination = grid_combination(size=3, goal=(2, 2), blocked=cells((1, 1), size=3))
    mdp = explored(combination)
    policy = rows_of(mdp, right=0.8, up=0.2)
    policy[(mdp.valuations[:, :2] == 2).all(axis=1)] = rows_of(mdp, stop=0.6, up=0.4)[0]
    figure = draw_map(combination, policy=policy)
    shapes = polygons(figure.axes[0], "policy")
    *moving, staying = shapes
    assert len(moving) == 7  # 9 cells without the blocked one and the goal
    tips = np.array([shape[3] for shape in moving])
    tails = np.array([(shape[0] + shape[6]) / 2 for shape in moving])
    assert (tips[:, 0] > tails[:, 0]).all()
    np.testing.assert_allclose(tips[:, 1], tails[:, 1], atol=1e-12)
    np.testing.assert_allclose(staying.mean(axis=0), [2, -2])
    assert {"moves", "stays"} <= set(legend_of(figure))


def test_what_a_policy_does_in_several_states_of_a_location_is_its_mean(tmp_path: Path) -> None:
    """With the door open it goes through, with the door shut it stays: half of the states each."""
    (tmp_path / "case.yaml").write_text(ROOMS, encoding="utf-8")
    rooms = declared(load_case(tmp_path).combination_at(0))
    mdp = explored(rooms)
    is_open = mdp.valuations[:, mdp.variable_names.index("door")] == 1
    policy = np.where(is_open[:, None], rows_of(mdp, east=1), rows_of(mdp, stop=0.4, east=0.6))
    moves = likeliest_moves(rooms, mdp, policy)
    assert list(moves) == [0]
    np.testing.assert_allclose(moves[0].prob, 0.8)
    shapes = polygons(draw_map(rooms, policy=policy).axes[0], "policy")
    assert len(shapes) == 2


def test_less_likely_moves_are_thinner_and_paler() -> None:
    combination = grid_combination(size=3, goal=(2, 2))
    mdp = explored(combination)
    policy = rows_of(mdp, right=1.0) * np.linspace(0.2, 1.0, mdp.num_states)[:, None]
    axes = draw_map(combination, policy=policy).axes[0]
    widths = [np.linalg.norm(shape[0] - shape[6]) for shape in polygons(axes, "policy")]
    greys = only(axes, "policy").get_facecolor()[:, 0]
    assert (np.diff(widths) > 0).all()
    assert (np.diff(greys) < 0).all()


def test_each_mode_that_can_move_has_its_own_arrows(building: DeclaredCombination) -> None:
    mdp = explored(building)
    policy = rows_of(mdp, start_scan=1)
    policy[mdp.valuations[:, mdp.variable_names.index("mode")] == 2] = rows_of(mdp, east=1)[0]
    figure = draw_map(building, policy=policy)
    texts = legend_of(figure)
    # The initial mode comes first.
    assert texts[-2:] == ["innate action in mode idle", "moves in mode scanned"]
    assert "moves in mode idle" not in texts
    idle, scanned = named(figure.axes[0], "policy")
    assert (len(idle.get_paths()), len(scanned.get_paths())) == (25, 25)


def test_a_policy_of_another_shape_is_refused(building: DeclaredCombination) -> None:
    with pytest.raises(ModelError, match=r"shape \(5, 5\), not \(\d+, 8\)"):
        draw_map(building, policy=np.ones((5, 5)))
