"""The shield where observations come late or never: what may be done then."""

from __future__ import annotations

import numpy as np
import pytest

from merap.belief.outside import Outside
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.case_study import load_declared_case
from merap.concerns.lookup import declared_case
from merap.errors import InputError
from merap.mdp.model import Bools
from merap.shield.learning_shield import LearningShield, ShieldSettings
from merap.systems.interface import Observation
from merap.systems.sightings import News, Sighting, Transition
from tests.support.paths import MODELS
from tests.support.shield_examples import gutter
from tests.support.trained_runs import grid_case

HORIZON = 40
STOP, RIGHT = 0, 1
# So many slides that did not come refute the wet gutter: (0.8 / 0.9)^n is below 1e-4 from 79 on, and
# twice that, as the odds of both are even, from 85 on.
REFUTING = 100


@pytest.fixture(scope="module")
def example() -> HypothesisSpace:
    """The running example: it is dark, and so unsafe, at B and in the store."""
    return hypothesis_space(load_declared_case(MODELS / "running-example"))


@pytest.fixture(scope="module")
def beside(tmp_path_factory: pytest.TempPathFactory) -> HypothesisSpace:
    """The gutter: each step to the right risks 0.2 until it is known to be dry, and then 0.1."""
    return hypothesis_space(gutter(tmp_path_factory.mktemp("case")), Outside(slips=(0.05,), odds=(1.0,)))


def state(space: HypothesisSpace, location: str) -> int:
    """The robot idles there."""
    return space.space.location_index[location] * space.num_modes


class Told:
    """A shield, and an episode that it is told of."""

    def __init__(self, space: HypothesisSpace, threshold: float) -> None:
        self.space = space
        self.shield = LearningShield(space, HORIZON, ShieldSettings(threshold))
        # In a terminal mode everything but the automaton's own action.
        self.enabled: Bools = np.array([name != "measure" for name in space.case.actions])
        self.time = 0

    def observation(self, location: str) -> Observation:
        return Observation(
            self.space.states.valuations[state(self.space, location)], self.enabled, -1.0, 1.0, False
        )

    def begin(self, location: str | None = None) -> None:
        """An episode, seen to begin at a location or not."""
        self.time = 0
        self.shield.begin()
        self.shield.follow([] if location is None else [self.sighting(location)], self.enabled)

    def sighting(self, location: str, time: int | None = None) -> Sighting:
        at = self.time if time is None else time
        return Sighting(state(self.space, location), self.observation(location), at)

    def transition(self, time: int, origin: str, action: int, target: str) -> Transition:
        ends = state(self.space, origin), action, state(self.space, target)
        return Transition(time, *ends, self.observation(target))

    def take(self, action: int, *news: News, fault: bool = False) -> None:
        """Execute an action, and learn what arrives."""
        self.shield.took(action, surely=not fault)
        self.time += 1
        self.shield.follow(news, None if fault else self.enabled)

    def step(self, origin: str, action: int, target: str) -> None:
        """A step that is seen at once."""
        self.take(action, self.transition(self.time, origin, action, target))

    def allowed(self) -> set[str]:
        mask = self.shield.allowed(self.enabled)
        return {name for name, free in zip(self.space.case.actions, mask, strict=True) if free}


def test_the_dark_is_not_entered(example: HypothesisSpace) -> None:
    told = Told(example, 0.0)
    told.begin("hall_nw")
    assert "east" not in told.allowed()
    assert {"stop", "south", "west", "start_scan"} <= told.allowed()


def test_steps_are_followed_and_counted(example: HypothesisSpace) -> None:
    told = Told(example, 0.0)
    told.begin("S")
    east = example.case.actions.index("east")
    assert "east" in told.allowed()
    told.step("S", east, "lobby")
    assert "east" in told.allowed()
    counts = told.shield.report()
    assert (counts.episodes, counts.steps, counts.worst_risk) == (1, 2, 0.0)


def test_all_places_where_the_system_may_be_count(example: HypothesisSpace) -> None:
    """East is dark from hall_nw; whether the way there from lobby was taken is not seen."""
    told = Told(example, 0.0)
    told.begin("lobby")
    assert "east" in told.allowed()
    names = example.case.actions
    north = next(number for number in range(len(names)) if _leads(example, number, "lobby", "hall_nw"))
    told.take(north)
    assert "east" not in told.allowed()
    assert "stop" in told.allowed()
    # It was not: the system is seen where it was, after a gap or at the end of the step.
    told.begin("lobby")
    told.take(north, told.sighting("lobby", 1))
    assert "east" in told.allowed()
    told.begin("lobby")
    told.step("lobby", north, "lobby")
    assert "east" in told.allowed()


def _leads(space: HypothesisSpace, action: int, origin: str, target: str) -> bool:
    table = space.actions[action]
    return state(space, target) in table.target[state(space, origin)].tolist()


def test_a_step_is_charged_and_an_episode_begins_with_a_whole_budget(beside: HypothesisSpace) -> None:
    told = Told(beside, 0.25)
    for _ in range(2):
        told.begin("r0c0")
        assert told.allowed() == {"stop", "right"}
        told.step("r0c0", RIGHT, "r0c1")
        assert told.allowed() == {"stop"}
    counts = told.shield.report()
    assert (counts.episodes, counts.steps, counts.withheld, counts.fallbacks) == (2, 4, 2, 0)
    assert counts.worst_risk == pytest.approx(0.2)


@pytest.mark.parametrize(("threshold", "times"), [(0.15, 0), (0.25, 1), (0.45, 2), (0.65, 3)])
def test_steps_that_are_seen_late_are_charged_when_they_are_executed(
    beside: HypothesisSpace, threshold: float, times: int
) -> None:
    """And once only: settled with what arrives two steps later."""
    told = Told(beside, threshold)
    told.begin("r0c0")
    crossed = 0
    while "right" in told.allowed():
        crossed += 1
        late = crossed - 2
        arrives = [told.transition(late - 1, f"r0c{late - 1}", RIGHT, f"r0c{late}")] if late > 0 else []
        told.take(RIGHT, *arrives)
    assert crossed == times
    for late in range(max(crossed - 1, 1), crossed + 1):
        told.take(STOP, told.transition(late - 1, f"r0c{late - 1}", RIGHT, f"r0c{late}"))
    assert told.allowed() == {"stop"}
    counts = told.shield.report()
    assert (counts.episodes, counts.fallbacks) == (1, 0)
    assert counts.steps == times + 2
    assert counts.withheld == 2


def test_after_a_gap_what_remained_remains(beside: HypothesisSpace) -> None:
    told = Told(beside, 0.45)
    told.begin("r0c0")
    told.take(RIGHT)
    assert told.allowed() == {"stop", "right"}
    told.take(STOP, told.sighting("r0c1", 2))
    assert told.allowed() == {"stop", "right"}
    told.take(RIGHT)
    told.take(STOP, told.sighting("r0c2", 4))
    assert told.allowed() == {"stop"}
    assert told.shield.report().episodes == 1


def test_until_it_is_seen_the_system_may_be_anywhere(example: HypothesisSpace) -> None:
    told = Told(example, 0.0)
    told.begin()
    assert not {"east", "west"} & told.allowed()
    assert "stop" in told.allowed()
    assert told.shield.report().fallbacks == 0
    told.take(example.case.actions.index("stop"), told.sighting("S", 0))
    assert "east" in told.allowed()


def test_after_a_fault_nothing_is_known_of_what_is_enabled(example: HypothesisSpace) -> None:
    """It is what was enabled before: the robot may scan, where it can't do anything else."""
    told = Told(example, 0.0)
    told.begin("S")
    told.take(example.case.actions.index("start_scan"), fault=True)
    told.allowed()
    assert told.shield.report().fallbacks == 1
    told.take(example.case.actions.index("stop"))
    assert "east" in told.allowed()
    assert told.shield.report().fallbacks == 1


def test_what_is_seen_loosens_the_very_next_step_and_what_is_forgotten_tightens_it(
    beside: HypothesisSpace,
) -> None:
    told = Told(beside, 0.15)
    told.begin("r0c0")
    assert told.allowed() == {"stop"}
    for number in range(REFUTING):
        told.begin("r0c0")
        told.take(RIGHT, told.transition(0, "r0c0", RIGHT, "r0c1"))
        loosened = told.shield.mask[state(beside, "r0c1"), RIGHT]
        assert loosened == (number + 1 >= 85)
    told.begin("r0c0")
    assert told.allowed() == {"stop", "right"}
    told.shield.forget(told.observation("r0c0"))
    assert told.allowed() == {"stop"}
    # It goes on to learn from where the system is.
    for _ in range(REFUTING):
        told.begin("r0c0")
        told.take(RIGHT, told.transition(0, "r0c0", RIGHT, "r0c1"))
    told.begin("r0c0")
    assert told.allowed() == {"stop", "right"}


def test_a_change_amid_an_episode_leaves_the_budget_spent(beside: HypothesisSpace) -> None:
    told = Told(beside, 0.25)
    told.begin("r0c0")
    step = told.transition(0, "r0c0", RIGHT, "r0c1")
    told.take(RIGHT, step)
    told.shield.forget(step.observation)
    assert told.allowed() == {"stop"}
    told.begin("r0c0")
    assert told.allowed() == {"stop", "right"}
    counts = told.shield.report()
    assert (counts.episodes, counts.steps) == (2, 2)


def test_a_change_while_a_step_is_not_settled_charges_it_by_what_is_credible_again(
    beside: HypothesisSpace,
) -> None:
    told = Told(beside, 0.35)
    for _ in range(REFUTING):
        told.begin("r0c0")
        told.take(RIGHT, told.transition(0, "r0c0", RIGHT, "r0c1"))
    told.begin("r0c0")
    told.take(RIGHT)
    assert "right" in told.allowed()
    told.shield.forget(told.observation("r0c0"))
    # 0.35 less 0.2 for the step on the way, where a step now costs 0.2 again; the next one too.
    assert told.allowed() == {"stop"}


def test_the_state_is_known_after_a_change(example: HypothesisSpace) -> None:
    told = Told(example, 0.0)
    told.begin("hall_nw")
    told.shield.forget(told.observation("hall_nw"))
    assert "east" not in told.allowed()
    assert {"stop", "south", "west", "start_scan"} <= told.allowed()
    counts = told.shield.report()
    assert (counts.episodes, counts.steps, counts.fallbacks) == (1, 2, 0)


def test_a_policy_is_carried_out_within_the_mask(example: HypothesisSpace) -> None:
    told = Told(example, 0.0)
    told.begin("hall_nw")
    east = example.case.actions.index("east")
    table = np.tile(np.eye(len(example.case.actions))[east], (example.num_states + 1, 1))
    masked, mask = told.shield.masked(table), told.shield.mask
    assert masked[state(example, "hall_nw"), east] == 0
    assert masked[state(example, "hall_nw")].sum() == pytest.approx(1)
    assert masked[state(example, "lobby"), east] == 1
    assert not mask[state(example, "hall_nw"), east]
    assert mask[state(example, "lobby"), east]


def test_a_policy_may_risk_more_where_less_is_left_of_the_way(beside: HypothesisSpace) -> None:
    """A step in each cell risks 0.2 from the last one, and 1 - 0.8^4 from the declared start."""
    told = Told(beside, 0.25)
    table = np.tile([1.0, 0.0], (HORIZON, beside.num_states + 1, 1))
    for time in range(4):
        table[time, state(beside, f"r0c{time}")] = [0.0, 1.0]
    last = state(beside, "r0c4")
    table[0, last] = [0.0, 1.0]
    assert told.shield.masked(table)[0, last, RIGHT] == 0
    told.begin("r0c4")
    assert told.shield.masked(table)[0, last, RIGHT] == 1


def test_where_nothing_is_unsafe_there_is_nothing_to_shield_from() -> None:
    with pytest.raises(InputError, match="unsafe"):
        LearningShield(hypothesis_space(declared_case(grid_case())), 18, ShieldSettings(0.0))
