"""Outcome sets of a belief, against every hypothesis as a model of its own; hazards by Bayes' rule."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from merap.belief.outside import Outside
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.errors import InputError
from merap.mdp.model import Bools, TabularMDP
from merap.shield.credible_tracker import CredibleTracker
from merap.shield.fixpoint import robust_risk
from merap.shield.hazards import Hazards
from merap.shield.models import model_sets
from merap.systems.interface import Observation
from merap.systems.slip import slipping_model
from tests.support.paths import MODELS
from tests.support.placed import as_believed

# Two rows of three cells; the upper one in the middle is a hole, and `up` may end beside.
LEDGE = """\
case: ledge
discount: 0.9
space:
  grid: {rows: 2, cols: 3, moves: {up: [-1, 0], down: [1, 0], left: [0, -1], right: [0, 1]}}
  attributes:
    hole: {type: bool, values: [{at: [[0, 1]], value: true}]}
  detectors:
    camera: {of: hole, range: 1, accuracy: 0.9}
environment:
  parameters: {blocked: locations}
  configurations: {a: {blocked: [[0, 2]]}, b: {blocked: []}}
capability:
  parameters: {no_entry: locations}
  actions:
    stop: {stay: 1}
    up: {move: up, probability: 0.75}
    down: {move: down}
    left: {move: left, probability: 0.9}
    right: {move: right, on_blocked: disable}
  configurations: {full: {no_entry: []}, lame: {no_entry: [[1, 2]]}}
objective:
  parameters: {goal: location}
  start: [1, 0]
  horizon: 8
  unsafe: hole
  rewards:
    - {at: goal, action: stop, value: 10}
    - {value: -0.5}
  ends_after: {at: goal, action: stop}
  configurations: {right: {goal: [0, 2]}, low: {goal: [1, 2]}}
"""
OUTSIDE = Outside(slips=(0.2, 0.3), odds=(1.0,))


@pytest.fixture(scope="module")
def ledge(tmp_path_factory: pytest.TempPathFactory) -> DeclaredCase:
    path = tmp_path_factory.mktemp("case") / "case.yaml"
    path.write_text(LEDGE, encoding="utf-8")
    return load_declared_case(path)


@cache
def shipped(name: str) -> tuple[DeclaredCase, HypothesisSpace]:
    case = load_declared_case(MODELS / name)
    return case, hypothesis_space(case)


def seen(space: HypothesisSpace, state: int, enabled: Bools, reward: float = 0.0) -> Observation:
    return Observation(space.states.valuations[state], enabled, reward, 1.0, False)


def hypotheses(space: HypothesisSpace, visited: set[int], slips: tuple[float, ...]) -> Iterator[TabularMDP]:
    """A model for every set of closed cells without those visited, every slip and objective."""
    case = space.case
    free = [place for place in range(case.space.num_locations) if place not in visited]
    for count in range(len(free) + 1):
        for closed in combinations(free, count):
            mask = np.isin(np.arange(case.space.num_locations), closed)
            for objective in case.supports.objective:
                base = case.combine(0, 0, 0)
                environment = replace(base.environment, blocked=mask)
                combination = replace(base, environment=environment, objective=objective)
                for slip in slips:
                    yield as_believed(space, slipping_model(combination, slip))


def test_every_hypothesis_and_no_more_where_an_action_has_one_move(ledge: DeclaredCase) -> None:
    # Obstacle or no entry, declared or not: any set of cells may be closed but the start. `hypotheses`
    # enumerates them; the tables never do.
    space = hypothesis_space(ledge, OUTSIDE)
    tracker = CredibleTracker(space, doubt=1e-12)
    everywhere = np.ones(len(ledge.actions), dtype=np.bool_)
    everywhere[ledge.actions.index("right")] = False
    tracker.begin(seen(space, 3, everywhere))
    # The way right is closed at the start, which the action's absence has told.
    closed = [model for model in hypotheses(space, {3}, (0.0, 0.3)) if not model.enabled[3, 4]]
    sets = model_sets(closed)
    expected = robust_risk(sets.outcomes(np.ones(len(closed), dtype=np.bool_)))
    found = robust_risk(tracker.outcomes())
    # Without the hole: a model in which it is reached has the way there open, also back.
    reached = np.any([model.reachable for model in closed], axis=0) & ~sets.unsafe.any(axis=0)
    reached[-1] = False
    np.testing.assert_allclose(found.of_states[reached], expected.of_states[reached], atol=1e-9)
    live = expected.of_actions < 1
    live[~reached] = False
    np.testing.assert_allclose(found.of_actions[live], expected.of_actions[live], atol=1e-9)
    assert live.sum() >= 4


def test_a_step_loosens_what_it_refutes(ledge: DeclaredCase) -> None:
    space = hypothesis_space(ledge, OUTSIDE)
    tracker = CredibleTracker(space, doubt=1e-12)
    every = np.ones(len(ledge.actions), dtype=np.bool_)
    tracker.begin(seen(space, 3, every))
    before = tracker.outcomes()
    assert tracker.outcomes() is before
    up, right = ledge.actions.index("up"), ledge.actions.index("right")
    # The middle of the lower row is open, since `right` is possible; under it the hole: to move up there
    # risks 0.75, whatever may be closed or slip.
    risk = robust_risk(before)
    assert risk.of_actions[4, up] == pytest.approx(0.75)
    assert not risk.certain[4, up]
    tracker.observe(right, seen(space, 4, every, -0.5))
    after = tracker.outcomes()
    assert after is not before
    # No move has failed, so that a place beyond may still be closed: nothing there is surely possible.
    assert robust_risk(after).of_states[4] == 0


@pytest.mark.parametrize("name", ["hazard-grid", "running-example"])
def test_the_prior_covers_every_model_of_the_base(name: str) -> None:
    case, space = shipped(name)
    models = [as_believed(space, slipping_model(one, 0.0)) for one in case.combinations()]
    base = robust_risk(model_sets(models).outcomes(np.ones(len(models), dtype=np.bool_)))
    found = robust_risk(CredibleTracker(space).outcomes())
    some = base.of_actions[:-1] < 1
    assert np.all(found.of_actions[:-1][some] >= base.of_actions[:-1][some] - 1e-8)
    assert np.all(found.of_states >= base.of_states - 1e-8)
    # Beside the disturbances, nothing is added that is unsafe: what is 1 is 1 in some model.
    assert np.array_equal(found.of_states == 1, base.of_states == 1)


def test_a_hazard_counts_when_its_location_is_entered(ledge: DeclaredCase) -> None:
    # Nothing else is unsafe on the lower row: right from the start risks h at once, and what lies
    # beyond need not be entered.
    space = hypothesis_space(ledge, OUTSIDE)
    tracker = CredibleTracker(space, hazard_prior=0.1)
    every = np.ones(len(ledge.actions), dtype=np.bool_)
    tracker.begin(seen(space, 3, every))
    right, stop = ledge.actions.index("right"), ledge.actions.index("stop")
    risk = robust_risk(tracker.outcomes())
    assert risk.of_actions[3, right] == pytest.approx(0.1)
    assert risk.of_actions[3, stop] == 0
    tracker.observe(right, seen(space, 4, every, -0.5))
    back = robust_risk(tracker.outcomes())
    # Both have been seen now.
    assert back.of_actions[3, right] == 0
    assert back.of_actions[4, right] == pytest.approx(0.1)


def test_a_reading_changes_the_odds_of_a_hazard(ledge: DeclaredCase) -> None:
    hazards = Hazards(ledge.combination_at(0), 0.2)
    hazards.visit(3, {"camera": {"r1c0": 0, "r1c1": 0, "r0c0": 1}})
    # Bayes' rule with an accuracy of 0.9: 0.2 * 0.1 / (0.2 * 0.1 + 0.8 * 0.9), and 0.18 / (0.18 + 0.08).
    assert hazards.prob[4] == pytest.approx(0.02 / 0.74)
    assert hazards.prob[0] == pytest.approx(0.18 / 0.26)
    assert hazards.prob[3] == 0
    assert hazards.prob[2] == 0.2
    hazards.visit(2, {})
    assert hazards.prob[2] == 0
    with pytest.raises(InputError, match="the detector camera reads 'dark'"):
        hazards.visit(2, {"camera": "dark"})


def test_declared_hazards_are_where_they_are_declared(ledge: DeclaredCase) -> None:
    hazards = Hazards(ledge.combination_at(0), 0.3, at={2, 5})
    assert hazards.prob.tolist() == [0, 0, 0.3, 0, 0, 0.3]
    with pytest.raises(InputError, match=r"must be in \[0, 1\), it is 1"):
        Hazards(ledge.combination_at(0), 1.0)


def test_a_case_without_unsafe_states_needs_a_prior() -> None:
    _, space = shipped("paper-grid/rq1-3.yaml")
    with pytest.raises(InputError, match="no objective says what is unsafe"):
        CredibleTracker(space)
    tracker = CredibleTracker(space, hazard_prior=0.05)
    tracker.begin(seen(space, 0, np.ones(5, dtype=np.bool_)))
    risk = robust_risk(tracker.outcomes())
    assert risk.of_states[0] == 0
    assert risk.of_actions[0, 2] == pytest.approx(0.05)


def test_a_doubt_out_of_range_is_refused() -> None:
    _, space = shipped("hazard-grid")
    with pytest.raises(InputError, match="doubt"):
        CredibleTracker(space, doubt=1.0)


def test_a_completing_step_into_an_unsafe_state_is_a_violation(ledge: DeclaredCase, tmp_path: Path) -> None:
    text = LEDGE.replace("ends_after: {at: goal, action: stop}", "ends_in: {where: hole}")
    path = tmp_path / "case.yaml"
    path.write_text(text, encoding="utf-8")
    case = load_declared_case(path)
    tracker = CredibleTracker(hypothesis_space(case, OUTSIDE))
    risk = robust_risk(tracker.outcomes())
    up = case.actions.index("up")
    # The hole ends the task. On the canonical index that looks like any other end.
    assert risk.of_actions[4, up] == pytest.approx(0.75)
    assert ledge.combination_at(0).objective.ends_in is None
