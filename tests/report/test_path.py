"""Paths through the locations: shortest paths worked out by hand, on both forms of a model."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from merap.concerns.combination import Combination
from merap.concerns.external_action import ExternalAction, Outcome
from merap.errors import ModelError
from merap.families.index import family_index, index_kinds
from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.evaluation import as_policy
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import backward_induction, value_iteration
from merap.report.geometry import offset_line
from merap.report.path import RoutePath, most_likely_path
from tests.support.hand_made import cells, graph_combination, grid_combination, number
from tests.support.process_cases import SERVICE
from tests.support.route_paths import written_path

# A 3 x 3 world with walls that leave one way from the top left corner to the goal:
#   S # G
#   . # .
#   . . .
ONE_WAY = grid_combination(size=3, goal=(0, 2), blocked=cells((0, 1), (1, 1), size=3))
WAY = "r0c0 -down-> r1c0 -down-> r2c0 -right-> r2c1 -right-> r2c2 -up-> r1c2 -up-> r0c2 (stop)"


def model(combination: Combination, form: str) -> TabularMDP:
    whole = explored(combination)
    if form == "whole":
        return whole
    kinds = index_kinds([combination.program])
    return family_index(kinds, combination.actions, [whole]).place(whole)


def best_policy(mdp: TabularMDP, combination: Combination) -> Floats:
    return as_policy(mdp, value_iteration(mdp, combination.discount).actions)


def always(mdp: TabularMDP, *actions: str) -> Floats:
    """In every state the first of these actions that is enabled there."""
    order = [mdp.action_names.index(action) for action in (*actions, "end")]
    first = mdp.enabled[:, order].argmax(axis=1)
    return as_policy(mdp, np.array(order)[first])


@pytest.mark.parametrize("form", ["whole", "index"])
def test_the_best_policy_takes_the_only_way(form: str) -> None:
    mdp = model(ONE_WAY, form)
    path = most_likely_path(mdp, ONE_WAY, best_policy(mdp, ONE_WAY), horizon=10)
    assert path.text == WAY
    assert path.places == tuple(ONE_WAY.space.locations[place] for place in (0, 3, 6, 7, 8, 5, 2, 2))
    assert path.actions == ("down", "down", "right", "right", "up", "up", "stop")
    assert path.changes == ("",) * 8
    assert path.completed


def test_a_time_indexed_policy_takes_the_shortest_way() -> None:
    mdp = model(grid_combination(), "index")
    plan = backward_induction(mdp, 18)
    path = most_likely_path(mdp, grid_combination(), as_policy(mdp, plan.actions), 18)
    # From (0, 0) to (4, 4) in 8 moves, then stop: 10 - 0.5 * 8 = 6.
    assert len(path.actions) == 9
    assert path.completed
    assert plan.value == pytest.approx(10 - 0.5 * (len(path.actions) - 1))


@pytest.mark.parametrize("form", ["whole", "index"])
def test_a_step_that_ends_by_moving_shows_where_it_ends(form: str) -> None:
    # The task ends in the goal itself, which the canonical index folds away.
    objective = replace(ONE_WAY.objective, ends_after=None, ends_in=ONE_WAY.objective.goal)
    combination = replace(ONE_WAY, objective=objective)
    mdp = model(combination, form)
    path = most_likely_path(mdp, combination, always_along_the_way(mdp), horizon=10)
    assert path.places[-2:] == ("r1c2", "r0c2")
    assert path.text == WAY.replace("(stop)", "(done)")


def always_along_the_way(mdp: TabularMDP) -> Floats:
    """Down in the left column, right in the bottom row, up in the right column."""
    row, column = mdp.valuations[:, 0], mdp.valuations[:, 1]
    names = np.select([column == 2, row == 2, column == 0], ["up", "right", "down"], "end")
    done = mdp.labels["done"]
    names = np.where(done, "end", names)
    return as_policy(mdp, np.array([mdp.action_names.index(name) for name in names]))


@pytest.mark.parametrize("form", ["whole", "index"])
def test_innate_actions_stay_and_may_complete(form: str) -> None:
    # The likelier start is A; the task is complete there once the mode is `scanned`.
    combination = graph_combination()
    mdp = model(combination, form)
    path = most_likely_path(mdp, combination, always(mdp, "measure", "start_scan"), horizon=5)
    assert path.text == "A, mode=idle [start_scan: mode=scanning] (measure: mode=scanned)"


def test_what_usually_fails_is_tried_again() -> None:
    rarely = tuple(
        ExternalAction(
            a.name, (replace(a.outcomes[0], probability=number("0.3")), Outcome(None, number("0.7"))), "stay"
        )
        for a in ONE_WAY.capability.external[1:]
    )
    capability = replace(ONE_WAY.capability, external=(ONE_WAY.capability.external[0], *rarely))
    combination = replace(ONE_WAY, capability=capability)
    mdp = model(combination, "index")
    assert most_likely_path(mdp, combination, best_policy(mdp, combination), 10).text == WAY


def test_a_loop_is_left_and_named() -> None:
    mdp = model(ONE_WAY, "index")
    stuck = most_likely_path(mdp, ONE_WAY, always(mdp, "up"), horizon=10)
    assert stuck.text == "r0c0 [up] (loop)"
    assert not stuck.completed
    to_and_fro = np.zeros((mdp.num_states, mdp.num_actions))
    to_and_fro[:, mdp.action_names.index("down")] = mdp.valuations[:, 0] == 0
    to_and_fro[:, mdp.action_names.index("up")] = mdp.valuations[:, 0] == 1
    assert most_likely_path(mdp, ONE_WAY, to_and_fro, 10).text == "r0c0 -down-> r1c0 -up-> r0c0 (loop)"


def test_the_horizon_ends_a_path() -> None:
    mdp = model(ONE_WAY, "index")
    path = most_likely_path(mdp, ONE_WAY, best_policy(mdp, ONE_WAY), horizon=2)
    assert path.text == "r0c0 -down-> r1c0 -down-> r2c0 (not completed)"
    assert (len(path.actions), path.ending) == (2, "open")


def test_disabled_actions_are_never_taken() -> None:
    # `back` leads nowhere from S and is disabled there, whatever the policy says.
    combination = graph_combination()
    at_s = replace(combination.objective, start=np.array([1.0, 0, 0, 0]))
    combination = replace(combination, objective=at_s)
    mdp = model(combination, "index")
    policy = np.full((mdp.num_states, mdp.num_actions), 0.01)
    policy[:, mdp.action_names.index("back")] = 0.9
    policy[:, mdp.action_names.index("go")] = 0.05
    path = most_likely_path(mdp, combination, policy, horizon=10)
    assert path.text == "S, mode=idle -go-> A -back-> S (loop)"


def test_without_a_map_the_values_tell_the_way(tmp_path: Path) -> None:
    """Servers are added; then the load is what changes, until it has been there before."""
    (tmp_path / "case.yaml").write_text(SERVICE, encoding="utf-8")
    service = load_case(tmp_path).combination("calm.fast.thrift")
    mdp = explored(service)
    path = most_likely_path(mdp, service, always(mdp, "grow", "keep"), 30)
    assert path.text == (
        "here, running=1, booting=0, load=1, seen=never [grow: booting=1] [keep: running=2, booting=0] "
        "[grow: booting=1] [keep: running=3, booting=0] [grow: booting=1] [keep: running=4, booting=0] "
        "[keep: load=0] [keep: load=1] (loop)"
    )


def test_under_a_policy_by_time_waiting_takes_its_time(tmp_path: Path) -> None:
    """In a calm the load rises from 0 with probability 0.1, so after ten steps on average."""
    (tmp_path / "case.yaml").write_text(SERVICE, encoding="utf-8")
    service = load_case(tmp_path).combination("calm.fast.thrift")
    mdp = explored(service)
    policy = np.repeat(always(mdp, "keep")[None], 30, axis=0)
    path = most_likely_path(mdp, service, policy, 30)
    # from load 1 something changes in 0.4 of the steps: 2.5 on average, down rather than up
    assert path.text == (
        "here, running=1, booting=0, load=1, seen=never [keep] [keep: load=0] [keep x9] [keep: load=1] "
        "[keep] [keep: load=0] [keep x9] [keep: load=1] [keep] [keep: load=0] [keep x4] (not completed)"
    )


def test_a_policy_that_does_not_know_a_state_is_refused(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text(SERVICE, encoding="utf-8")
    busier = load_case(tmp_path).combination("rush.fast.thrift")
    (tmp_path / "case.yaml").write_text(SERVICE.replace("up: 0.1", "up: 0"), encoding="utf-8")
    mdp = explored(load_case(tmp_path).combination("calm.fast.thrift"))
    with pytest.raises(ModelError, match=r"does not know .*load=2"):
        most_likely_path(mdp, busier, always(mdp, "keep"), 30)


def test_an_action_that_a_policy_does_not_know_is_the_last_to_take(tmp_path: Path) -> None:
    shorter = re.sub(r".*(grow:|action: grow).*\n", "", SERVICE)
    (tmp_path / "case.yaml").write_text(shorter, encoding="utf-8")
    without_growing = explored(load_case(tmp_path).combination("calm.fast.thrift"))
    assert "grow" not in without_growing.action_names
    (tmp_path / "case.yaml").write_text(SERVICE, encoding="utf-8")
    service = load_case(tmp_path).combination("calm.fast.thrift")
    path = most_likely_path(without_growing, service, always(without_growing, "keep"), 30)
    assert set(path.actions) == {"keep"}


def test_a_recorded_path_counts_what_was_repeated() -> None:
    steps = [(0, "down"), (3, "left"), (3, "left"), (3, "left"), (3, "up"), (0, "up")]
    path = written_path(ONE_WAY, steps, 0, label="before")
    assert path.text == "r0c0 -down-> r1c0 [left x3] -up-> r0c0 [up] (not completed)"
    assert path.label == "before"


def test_a_task_complete_at_once_has_no_step() -> None:
    assert RoutePath(("S",), ("",), (), "completed").text == "S (done)"


def test_a_policy_of_another_shape_is_refused() -> None:
    mdp = model(ONE_WAY, "index")
    with pytest.raises(ModelError, match=r"shape \(9, 6\), not \(11, 6\)"):
        most_likely_path(mdp, ONE_WAY, np.ones((9, 6)), 10)
    with pytest.raises(ModelError, match=r"shape \(4, 11, 6\), not \(5, 11, 6\)"):
        most_likely_path(mdp, ONE_WAY, np.ones((4, 11, 6)), 5)


def test_offset_lines_have_mitres_and_bevels() -> None:
    # A left turn, moved to the right by 0.1, worked out by hand; then a turn back.
    corner = offset_line(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), 0.1)
    np.testing.assert_allclose(corner[1:4:2], [[0.0, -0.1], [1.1, -0.1]], atol=1e-12)
    np.testing.assert_allclose(corner[-1], [1.1, 1.0])
    back = offset_line(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]), 0.1)
    np.testing.assert_allclose(back[2:4], [[1.0, -0.1], [1.0, 0.1]], atol=1e-12)
