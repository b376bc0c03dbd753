"""What the shield learns counts in the very next step; gutter and figures as in `test_loop_shield`."""

from __future__ import annotations

import numpy as np
import pytest

from merap.belief.outside import Outside
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.mdp.model import Bools, Floats
from merap.shield.credible import credible
from merap.shield.credible_tracker import DOUBT, CredibleTracker
from merap.shield.learning_shield import LearningShield, ShieldSettings
from merap.shield.shielded_strategy import ShieldedStrategy
from merap.systems.interface import Observation
from tests.support.loop_examples import Told
from tests.support.shield_examples import gutter

STOP, RIGHT = 0, 1
BOTH = np.ones(2, dtype=np.bool_)
# Both slides are as likely at first, so one is credible while its likelihood is above 1e-4 of the mean of
# both: for a slide of 0.2 against 0.1, with n steps that did not slide, while 2 / (1 + (9 / 8)^n) > 1e-4.
REFUTED = 85


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> HypothesisSpace:
    return hypothesis_space(gutter(tmp_path_factory.mktemp("case")), Outside(slips=(0.05,), odds=(1.0,)))


def at(space: HypothesisSpace, cell: int) -> Observation:
    return Observation(space.states.valuations[cell], BOTH, -1.0, 1.0, False)


class Restricted(Told):
    """A planner that takes down what it may plan with, and what it may do."""

    def __init__(self, space: HypothesisSpace) -> None:
        super().__init__(STOP, shape=(space.num_states + 1, 2))
        self.masks: list[Bools] = []
        self.allowed: list[Bools] = []

    def restrict(self, mask: Bools) -> None:
        self.masks.append(mask)

    def act(self, allowed: Bools) -> int:
        self.allowed.append(allowed)
        return super().act(allowed)

    def policy(self) -> Floats:
        return np.full(self.shape, 0.5)


def test_a_step_that_refutes_a_model_loosens_the_next_one(space: HypothesisSpace) -> None:
    """0.35 less 0.2 leaves 0.15, enough once a step costs 0.1: from the 85th slide that did not come."""
    assert 2 / (1 + (9 / 8) ** (REFUTED - 1)) > DOUBT >= 2 / (1 + (9 / 8) ** REFUTED)
    planner = Restricted(space)
    strategy = ShieldedStrategy(planner, space, 10, ShieldSettings(0.35))
    for number in range(1, REFUTED + 1):
        strategy.begin(at(space, 0))
        strategy.observe(RIGHT, at(space, 1))
        strategy.act(BOTH)
        assert planner.allowed[-1][RIGHT] == (number == REFUTED)
    assert strategy.report().steps == REFUTED


def test_what_is_seen_when_an_episode_begins_counts_for_it(space: HypothesisSpace) -> None:
    """A hazard of 0.1 where it begins is none: the step into it costs 0.2, not 0.2 + 0.8 * 0.1."""
    planner = Restricted(space)
    strategy = ShieldedStrategy(planner, space, 10, ShieldSettings(0.25, hazard_prior=0.1))
    assert not planner.masks[-1][2, RIGHT]
    strategy.begin(at(space, 3))
    assert planner.masks[-1][2, RIGHT]


def test_a_step_is_charged(space: HypothesisSpace) -> None:
    planner = Restricted(space)
    strategy = ShieldedStrategy(planner, space, 10, ShieldSettings(0.25))
    strategy.begin(at(space, 0))
    strategy.act(BOTH)
    strategy.observe(RIGHT, at(space, 1))
    strategy.act(BOTH)
    assert [bool(mask[RIGHT]) for mask in planner.allowed] == [True, False]
    report = strategy.report()
    assert (report.episodes, report.steps, report.withheld) == (1, 2, 1)
    assert report.worst_risk == pytest.approx(0.2)


def test_the_policy_is_masked_for_where_the_episode_began(space: HypothesisSpace) -> None:
    """In the last cell a step to the right can't be made but slides all the same: 0.2, each time."""
    shield = LearningShield(space, 3, ShieldSettings(0.25))
    table = np.zeros((3, space.num_states + 1, 2))
    table[:, :, STOP] = 1.0
    table[0, :6] = table[1, 1] = table[2, 2] = [0.0, 1.0]
    # From the declared start three steps risk 1 - 0.8^3, from the last cell there is one.
    assert shield.masked(table)[0, 5, RIGHT] == 0
    shield.begin()
    shield.sighted(0, at(space, 5))
    shield.refresh()
    assert shield.masked(table)[0, 5, RIGHT] == 1
    assert shield.least_risk == 0


def test_where_the_system_is_it_is_not_closed(space: HypothesisSpace) -> None:
    """An unknown obstacle there is refuted by being there, however it came there."""
    tracker = CredibleTracker(space)
    before = credible(space, tracker.belief, DOUBT)
    tracker.begin(at(space, 2))
    after = credible(space, tracker.belief, DOUBT)
    assert before.closed[..., 2].any()
    assert not after.closed[..., 2].any()
    np.testing.assert_array_equal(after.closed[..., 3], before.closed[..., 3])


def test_what_is_forgotten_is_credible_again(space: HypothesisSpace) -> None:
    """Also what was read of hazards, but for where the system is."""
    shield = LearningShield(space, 10, ShieldSettings(0.25, hazard_prior=0.1))
    shield.begin()
    shield.sighted(0, at(space, 3))
    shield.refresh()
    assert shield.mask[2, RIGHT]
    shield.forget(at(space, 1))
    assert not shield.mask[2, RIGHT]
    assert shield.mask[0, RIGHT]
    assert shield.report().changes == 2
