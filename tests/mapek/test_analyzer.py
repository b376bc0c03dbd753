from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from merap.belief.posterior import concern_weights
from merap.belief.prior_update import SHARE
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.lookup import declared_case
from merap.mapek.analyzer import PATIENCE, Analyzer
from merap.mapek.messages import AdaptedPolicy
from merap.mdp.model import Floats
from merap.mdp.planning import optimum
from merap.strategies.fixed import optimal_policy
from merap.systems.sightings import Sighting, Transition
from merap.trigger.trigger import Alarm
from tests.support.loop_examples import Doubtful, monitored, seen
from tests.support.trained_runs import grid_case

STOP, UP, DOWN, LEFT, RIGHT = range(5)
COMPLETED, HORIZON = 81, 18
# any policy will do
STILL = np.tile(np.eye(5)[STOP], (COMPLETED + 1, 1))


@pytest.fixture(scope="module")
def space() -> HypothesisSpace:
    """RQ1-3: one of (3, 4), (4, 3), (3, 3) can't be entered; the goal is (4, 4)."""
    return hypothesis_space(declared_case(grid_case()))


def cell(row: int, col: int) -> int:
    return 9 * row + col


def step(before: tuple[int, int], action: int, after: tuple[int, int], reward: float = -0.5) -> Transition:
    return Transition(0, cell(*before), action, cell(*after), seen(*after, reward))


def capabilities(space: HypothesisSpace, analyzer: Analyzer) -> Floats:
    """[C], their weights."""
    _, weights, _ = concern_weights(space, analyzer.belief)
    return weights


def no_entry(space: HypothesisSpace, analyzer: Analyzer) -> list[str]:
    """The capabilities that are left."""
    weights = capabilities(space, analyzer)
    return [name for name, mass in zip(space.capability_names, weights, strict=True) if mass > 0.1]


class AtTheEnd(Doubtful):
    """A trigger that alarms at the end of an episode."""

    def episode_over(self) -> Alarm | None:
        return Alarm("threshold", -1.0, 0.0, "it earned too little")


def bumped(space: HypothesisSpace, trigger: Doubtful | None = None, *, forget: bool = True) -> Analyzer:
    """An analyzer that has seen (3, 4) closed, from the left, too often for a slip."""
    analyzer = Analyzer(space, HORIZON, 3, trigger, forget=forget)
    left = step((3, 3), RIGHT, (3, 3))
    analyzer.analyse(monitored(cell(3, 3), [Sighting(cell(3, 3), seen(3, 3), 0), *[left] * 10]))
    return analyzer


def test_while_adapting_the_belief_follows_what_is_seen(space: HypothesisSpace) -> None:
    analyzer = Analyzer(space, HORIZON, 3, None)
    assert len(no_entry(space, analyzer)) == 3
    analysis = analyzer.analyse(monitored(cell(3, 3), [Sighting(cell(3, 3), seen(3, 3), 0)]))
    assert (analysis.phase, analysis.replan) == ("adapting", False)
    assert no_entry(space, bumped(space)) == [space.capability_names[0]]


def test_the_model_is_an_mdp_on_the_canonical_index(space: HypothesisSpace) -> None:
    """With (3, 4) closed the goal is still 8 steps away: 10 - 8 / 2, less what is kept for surprises."""
    model = bumped(space).tabular()
    assert model.num_states == COMPLETED + 1
    assert optimum(model, 18) == pytest.approx(6, abs=0.5)


def test_while_executing_the_model_stays(space: HypothesisSpace) -> None:
    analyzer = bumped(space)
    analyzer.settle(STILL)
    before = analyzer.belief
    analysis = analyzer.analyse(monitored(cell(0, 1), [step((0, 0), RIGHT, (0, 1))]))
    assert analysis.phase == "executing"
    assert analyzer.belief is before


def test_readings_hold_what_is_seen_against_the_model(space: HypothesisSpace) -> None:
    """The base has no slip; 5 % of the prior is shared by slips of 5, 10, 20 and 40 %, 18.75 % on average."""
    trigger = Doubtful()
    analyzer = Analyzer(space, HORIZON, 3, trigger)
    analyzer.settle(STILL)
    analyzer.analyse(monitored(cell(0, 1), [step((0, 0), RIGHT, (0, 1))]))
    (reading,) = trigger.readings
    assert reading.expected_reward == pytest.approx(-0.5)
    assert reading.reward == -0.5
    assert -0.1 < reading.log_likelihood < 0
    assert (trigger.gaps, trigger.ends) == ([], [])


def test_the_trigger_is_told_of_every_end_and_of_what_was_not_seen(space: HypothesisSpace) -> None:
    """Right twice, in four episodes: seen whole, with the state between lost, given up, and seen again."""
    trigger = Doubtful()
    analyzer = Analyzer(space, HORIZON, 3, trigger)
    analyzer.settle(STILL)
    first, second = step((0, 0), RIGHT, (0, 1)), replace(step((0, 1), RIGHT, (0, 2)), time=1)
    begun = monitored(cell(0, 0), [Sighting(cell(0, 0), seen(0, 0), 0)])

    def after(number: int, *news: Transition | Sighting, last: bool = False) -> None:
        analyzer.analyse(monitored(None, news, step=number, last=last))

    analyzer.analyse(begun)
    after(1, first)
    after(2, second, last=True)
    assert (len(trigger.readings), trigger.gaps, trigger.ends) == (2, [], [2])
    analyzer.analyse(begun)
    after(1)
    after(2, Sighting(cell(0, 2), seen(0, 2), 2), last=True)
    assert (len(trigger.readings), trigger.gaps, trigger.ends) == (2, [2], [2, 2])
    analyzer.analyse(begun)
    after(1, first)
    after(2)
    after(3)
    after(4, last=True)
    assert (len(trigger.readings), trigger.gaps, trigger.ends) == (3, [2, 3], [2, 2, 3])
    analyzer.analyse(monitored(None))  # what the reset answered was lost
    after(1, Sighting(cell(0, 1), seen(0, 1), 1))
    after(2, second, last=True)
    assert (len(trigger.readings), trigger.gaps, trigger.ends) == (4, [2, 3, 3], [2, 2, 3, 4])


def test_an_alarm_at_the_end_of_an_episode_needs_no_news(space: HypothesisSpace) -> None:
    """The last step is lost; what was seen before is reason enough."""
    analyzer = Analyzer(space, HORIZON, 3, AtTheEnd())
    analyzer.settle(STILL)
    assert not analyzer.analyse(monitored(cell(0, 1), [step((0, 0), RIGHT, (0, 1))], step=1)).replan
    analysis = analyzer.analyse(monitored(None, step=2, last=True))
    assert (analysis.replan, analysis.phase) == (True, "adapting")


def test_an_alarm_makes_the_analyzer_start_anew(space: HypothesisSpace) -> None:
    trigger = Doubtful()
    analyzer = bumped(space, trigger)
    analyzer.settle(STILL)
    through = step((2, 4), DOWN, (3, 4))  # where it could not be entered
    analysis = analyzer.analyse(monitored(cell(3, 4), [through]))
    assert analysis.replan
    assert analysis.phase == "adapting"
    assert analysis.reasons == ("what happened was held impossible",)
    assert trigger.replannings == 1
    # from the prior: (3, 4) is open, so it is one of the two others
    assert no_entry(space, analyzer) == list(space.capability_names[1:3])


def test_a_replanning_may_begin_with_half_of_what_was_believed(space: HypothesisSpace) -> None:
    """That (3, 4) can't be entered is certain before, and no more than likely afterwards."""
    analyzer = bumped(space, Doubtful(), forget=False)
    before = capabilities(space, analyzer)
    assert before.max() > 0.99
    analyzer.settle(STILL)
    # no hypothesis allows that, so it tells nothing
    analysis = analyzer.analyse(monitored(cell(8, 8), [step((0, 0), RIGHT, (8, 8))]))
    assert analysis.replan
    prior = capabilities(space, Analyzer(space, HORIZON, 3, None))
    expected = SHARE * before + (1 - SHARE) * prior
    np.testing.assert_allclose(capabilities(space, analyzer), expected, atol=1e-3)


@pytest.mark.parametrize("trigger", [Doubtful(), None])
def test_a_change_amid_an_adaptation_is_noticed_where_anything_is_heeded(
    space: HypothesisSpace, trigger: Doubtful | None
) -> None:
    """(3, 4) could not be entered in the first episode; in the second it is entered again and again."""
    analyzer = bumped(space, trigger)
    through = [step((3, 3), RIGHT, (3, 4)), step((3, 4), LEFT, (3, 3))]
    start = Sighting(cell(3, 3), seen(3, 3), 0)
    first = analyzer.analyse(replace(monitored(cell(3, 3), [start]), episode=1))
    assert not first.replan
    analysis = analyzer.analyse(replace(monitored(cell(3, 3), through * 6, step=12), episode=1))
    assert analysis.replan == (trigger is not None)
    if trigger is not None:
        assert analysis.phase == "adapting"
        assert "what was seen from episode 1 on" in analysis.reasons[0]
        # that episode is known, the one before it forgotten
        assert space.capability_names[0] not in no_entry(space, analyzer)


def test_what_ends_the_task_is_likely_where_it_ends(space: HypothesisSpace) -> None:
    trigger = Doubtful()
    analyzer = Analyzer(space, HORIZON, 3, trigger)
    analyzer.settle(STILL)
    ended = Transition(8, cell(4, 4), STOP, COMPLETED, seen(-1, -1, 10.0, ended=True))
    early = Transition(0, cell(0, 0), STOP, COMPLETED, seen(-1, -1, -0.5, ended=True))
    analyzer.analyse(monitored(COMPLETED, [ended], last=True))
    assert trigger.readings[0].log_likelihood > math.log(0.9)
    # 5 % of the prior mass is shared by the 79 other goals that the start is not
    assert analyzer.analyse(monitored(COMPLETED, [early], last=True)).replan
    assert trigger.readings[1].log_likelihood < math.log(0.01)


def test_where_the_system_is_not_seen_it_is_predicted(space: HypothesisSpace) -> None:
    analyzer = Analyzer(space, HORIZON, 3, None)
    blind = analyzer.analyse(monitored(None, seen_state=cell(0, 0), since=(RIGHT, DOWN)))
    assert blind.whereabouts.sum() == pytest.approx(1)
    assert int(blind.whereabouts.argmax()) == cell(1, 1)
    assert blind.whereabouts[cell(1, 1)] > 0.9


def test_a_new_episode_begins_at_the_start_though_nothing_was_seen(space: HypothesisSpace) -> None:
    blind = Analyzer(space, HORIZON, 3, None).analyse(monitored(None))
    assert np.flatnonzero(blind.whereabouts).tolist() == [0]


def test_a_state_that_is_seen_is_certain(space: HypothesisSpace) -> None:
    known = Analyzer(space, HORIZON, 3, None).analyse(
        monitored(cell(5, 5), [Sighting(cell(5, 5), seen(5, 5), 0)])
    )
    assert np.flatnonzero(known.whereabouts).tolist() == [cell(5, 5)]


def update(number: int, table: Floats) -> AdaptedPolicy:
    return AdaptedPolicy(number, table, ())


def best(space: HypothesisSpace, analyzer: Analyzer) -> Floats:
    return optimal_policy(analyzer.tabular(), HORIZON)


def test_an_adaptation_ends_with_a_good_policy_and_no_more_news(space: HypothesisSpace) -> None:
    analyzer = bumped(space)
    good = best(space, analyzer)
    assert not analyzer.enough(update(1, good))
    assert not analyzer.enough(update(2, good))
    assert not analyzer.enough(update(3, STILL))
    assert analyzer.enough(update(4, good))


def test_an_adaptation_goes_on_while_there_is_news(space: HypothesisSpace) -> None:
    analyzer = bumped(space)
    good = best(space, analyzer)
    assert not analyzer.enough(update(3, good))
    assert analyzer.enough(update(4, good))


def test_an_adaptation_does_not_go_on_for_ever(space: HypothesisSpace) -> None:
    analyzer = bumped(space)
    found = [analyzer.enough(update(number, STILL)) for number in range(1, 3 * PATIENCE + 1)]
    assert found == [False] * (3 * PATIENCE - 1) + [True]


def test_an_adaptation_without_an_end(space: HypothesisSpace) -> None:
    analyzer = Analyzer(space, HORIZON, None, None)
    assert not analyzer.enough(update(1000, best(space, analyzer)))
