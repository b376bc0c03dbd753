"""The budget where observations are late or lost: exact probabilities, over all histories of small models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from merap.shield.budget import permitted
from merap.shield.fixpoint import Risk, robust_risk
from merap.shield.outcomes import OutcomeSets
from merap.shield.partially_observed_budget import Charge, PartiallyObservedBudget, consistent
from tests.support.shield_examples import Sets, make_sets, random_sets

BOTH = np.ones(2, dtype=np.bool_)
# Five steps along a ledge: action 0 goes on and falls by 0.1, action 1 waits. State 6 is unsafe.
CORRIDOR: Sets = {
    **{place: {0: [{place + 1: 0.9, 6: 0.1}], 1: [{place: 1.0}]} for place in range(5)},
    5: {0: [{5: 1.0}], 1: [{5: 1.0}]},
}


@dataclass(frozen=True)
class Took:
    """An action was executed."""

    action: int


@dataclass(frozen=True)
class Saw:
    """The system was seen in a state, after so many actions."""

    state: int
    time: int


Event = Took | Saw


@dataclass(frozen=True, eq=False)
class Place:
    """Sets, their risk, and a threshold."""

    choices: Sets
    sets: OutcomeSets
    risk: Risk
    threshold: float

    def budget(self, history: Sequence[Event]) -> PartiallyObservedBudget:
        """After a history."""
        found = PartiallyObservedBudget(self.threshold, self.sets)
        for event in history:
            if isinstance(event, Took):
                found.charge(Charge(event.action, True, self.risk, self.sets))
            else:
                found.see(event.state, event.time, self.risk.unsafe)
        return found

    def allowed(self, history: Sequence[Event]) -> tuple[list[int], bool]:
        """Actions, and whether none is within the budget."""
        budget = self.budget(history)
        states = budget.states(self.risk.unsafe)
        mask, none = permitted(self.risk, states, budget.budgets[states], BOTH)
        return np.flatnonzero(mask).tolist(), bool(none)


def place(choices: Sets, threshold: float, num_states: int = 4) -> Place:
    sets = make_sets(choices, {num_states - 1}, num_states=num_states)
    return Place(choices, sets, robust_risk(sets, precision=1e-14), threshold)


def worst_violation(world: Place, delay: int | None, steps: int, *, conflicts: bool) -> float:
    """The greatest probability of a violation before nothing is within the budget.

    By recursion over all histories: nature picks distributions, whoever acts takes the worst action that
    is allowed, and knows the state, which the budget does not. Observations are late by `delay`; None:
    whether one is lost is whatever is worst.
    """

    @cache
    def worst(history: tuple[Event, ...], state: int, time: int, late: tuple[Saw, ...]) -> float:
        if world.risk.unsafe[state]:
            return 1.0
        if time == steps:
            return 0.0
        actions, none = world.allowed(history)
        if none:
            assert conflicts
            return 0.0
        found = 0.0
        for action in actions:
            for distribution in world.choices[state][action]:
                total = sum(
                    prob * onward((*history, Took(action)), Saw(successor, time + 1), late)
                    for successor, prob in distribution.items()
                )
                found = max(found, total)
        return found

    def onward(history: tuple[Event, ...], saw: Saw, late: tuple[Saw, ...]) -> float:
        if delay is None:
            lost = worst(history, saw.state, saw.time, ())
            return max(lost, worst((*history, saw), saw.state, saw.time, ()))
        under_way = (*late, saw)
        arrived, kept = under_way[: len(under_way) - delay], under_way[len(under_way) - delay :]
        return worst((*history, *arrived), saw.state, saw.time, kept)

    return worst((Saw(0, 0),), 0, 0, ())


def gentle(seed: int, *, everywhere: bool) -> Sets:
    """Random outcomes with a tenth of the risk, so that a budget lasts for some steps.

    One action waits: number 1 everywhere, or another one in each state.
    """
    choices, _ = random_sets(np.random.default_rng(seed), most=2)

    def gentler(state: int, distribution: Mapping[int, float]) -> dict[int, float]:
        eased = {successor: prob for successor, prob in distribution.items() if successor != 3}
        fall = distribution.get(3, 0.0)
        eased[state] = eased.get(state, 0.0) + 0.9 * fall
        return {**eased, 3: 0.1 * fall}

    return {
        state: {
            action: [{state: 1.0}]
            if action == (1 if everywhere else state % 2)
            else [gentler(state, one) for one in found]
            for action, found in actions.items()
        }
        for state, actions in choices.items()
    }


@pytest.mark.parametrize(("delay", "steps"), [(0, 5), (1, 5), (2, 5), (None, 4)])
@pytest.mark.parametrize("everywhere", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_no_behaviour_exceeds_the_budget_however_late_it_sees(
    seed: int, everywhere: bool, delay: int | None, steps: int
) -> None:
    """Where one action changes nothing anywhere, there always is one within the budget."""
    world = place(gentle(seed, everywhere=everywhere), 0.1)
    assert world.risk.of_states[0] == 0
    found = worst_violation(world, delay, steps, conflicts=delay != 0 and not everywhere)
    assert found <= world.threshold + 1e-9


def crossings(world: Place, late: int | None) -> int:
    """How often whoever crosses while that is allowed does so; None: each step ends in a gap."""
    history: list[Event] = [Saw(0, 0)]
    for count in range(5):
        if 0 not in world.allowed(history)[0]:
            return count
        history.append(Took(0))
        seen = count + 1 - (late or 0)
        if late is not None and seen > 0:
            history.append(Saw(seen, seen))
    return 5


@pytest.mark.parametrize("late", [0, 1, 2, 4, None])
@pytest.mark.parametrize(("threshold", "times"), [(0.05, 0), (0.1, 1), (0.25, 2), (0.35, 3)])
def test_what_is_crossed_is_paid_however_late_it_is_seen(
    threshold: float, times: int, late: int | None
) -> None:
    """Each crossing risks 0.1 of lambda."""
    assert crossings(place(CORRIDOR, threshold, 7), late) == times


def test_a_gap_renews_nothing() -> None:
    """What is seen after a gap has what the worst way there has left; the budget was whole at first."""
    world = place(CORRIDOR, 0.25, 7)
    assert world.budget([Saw(0, 0), Took(0), Took(1), Saw(1, 2)]).budgets[1] == pytest.approx(0.15)
    assert world.budget([Saw(0, 0), Took(0), Took(0), Saw(2, 2)]).budgets[2] == pytest.approx(0.05)


# From 0 both actions may lead to 1 or to 2; action 0 risks nothing, action 1 0.2. From 2 it costs more.
FORK: Sets = {
    0: {0: [{1: 0.5, 2: 0.5}], 1: [{1: 0.4, 2: 0.4, 3: 0.2}]},
    1: {0: [{1: 1.0}], 1: [{1: 0.9, 3: 0.1}]},
    2: {0: [{2: 1.0}], 1: [{2: 0.6, 3: 0.4}]},
}


def test_what_is_not_seen_is_charged_at_its_worst_and_settled_later() -> None:
    world = place(FORK, 0.5)
    hidden: list[Event] = [Saw(0, 0), Took(0), Took(1)]
    # 0.1 in state 1, 0.4 in state 2; which it was is told by where it is.
    assert world.budget(hidden).budgets[1] == pytest.approx(0.4)
    assert world.budget(hidden).budgets[2] == pytest.approx(0.1)
    assert world.allowed(hidden) == ([0], False)
    assert world.allowed([*hidden, Saw(1, 1)]) == ([0, 1], False)
    assert world.allowed([*hidden, Saw(2, 1)]) == ([0], False)
    settled = world.budget([*hidden, Saw(2, 1)])
    assert np.isinf(settled.budgets[1])
    # What arrives too late to be news changes nothing.
    np.testing.assert_array_equal(world.budget([*hidden, Saw(2, 1), Saw(0, 0)]).budgets, settled.budgets)


def test_until_it_is_seen_the_system_may_be_anywhere_with_the_whole_budget() -> None:
    world = place(FORK, 0.3)
    assert world.budget([]).states(world.risk.unsafe).tolist() == [0, 1, 2]
    assert world.allowed([]) == ([0], False)
    assert world.allowed([Saw(1, 0)]) == ([0, 1], False)


def test_in_no_single_state_is_an_action_wanting_but_in_all_of_them_one_may_be() -> None:
    """A conflict: where it is, one of the two is safe; the less risky one is left, and it is said."""
    choices: Sets = {
        0: {0: [{1: 0.5, 2: 0.5}], 1: [{1: 0.5, 2: 0.5}]},
        1: {0: [{1: 1.0}], 1: [{1: 0.5, 3: 0.5}]},
        2: {0: [{2: 0.8, 3: 0.2}], 1: [{2: 1.0}]},
    }
    world = place(choices, 0.1)
    assert world.allowed([Saw(0, 0), Took(0)]) == ([0], True)
    assert world.allowed([Saw(0, 0), Took(0), Saw(2, 1)]) == ([1], False)


def test_an_action_that_may_not_have_been_executed_counts_as_both() -> None:
    world = place(CORRIDOR, 0.25, 7)
    budget = world.budget([Saw(0, 0)])
    budget.charge(Charge(0, False, world.risk, world.sets))
    assert budget.states(world.risk.unsafe).tolist() == [0, 1]
    assert budget.budgets[0] == 0.25
    assert budget.budgets[1] == pytest.approx(0.15)


def test_what_is_enabled_tells_where_the_system_is() -> None:
    choices: Sets = {0: {0: [{1: 0.5, 2: 0.5}]}, 1: {0: [{1: 1.0}]}, 2: {1: [{2: 1.0}]}}
    world = place(choices, 0.1)
    first = np.array([True, False])
    assert consistent(world.sets, first).tolist() == [True, True, False, False]
    budget = world.budget([Saw(0, 0), Took(0)])
    assert budget.states(world.risk.unsafe).tolist() == [1, 2]
    budget.show(first, world.sets)
    assert budget.states(world.risk.unsafe).tolist() == [1]
    # It is remembered when the charges are made again, and ignored if it fits nowhere.
    budget.see(0, 0, world.risk.unsafe)
    assert budget.states(world.risk.unsafe).tolist() == [1]
    budget.show(BOTH, world.sets)
    assert budget.states(world.risk.unsafe).tolist() == [1]
    unsure = make_sets(choices, {3}, num_states=4, unsure={(1, 0)})
    assert consistent(unsure, np.zeros(2, dtype=np.bool_)).tolist() == [False, True, False, True]


def test_a_state_that_nothing_explains_has_the_least_that_may_be_left() -> None:
    world = place(CORRIDOR, 0.25, 7)
    budget = world.budget([Saw(0, 0), Took(0), Saw(4, 1)])
    assert budget.budgets[4] == pytest.approx(0.15)


def test_a_violation_that_is_seen_begins_a_new_budget_and_one_that_is_not_seen_does_not() -> None:
    choices: Sets = {0: {0: [{0: 0.9, 1: 0.1}], 1: [{0: 1.0}]}, 1: {0: [{0: 1.0}], 1: [{1: 1.0}]}}
    world = place(choices, 0.15, 2)
    assert world.budget([Saw(0, 0), Took(0), Saw(1, 1)]).budgets[1] == 0.15
    hidden = world.budget([Saw(0, 0), Took(0)])
    assert hidden.states(world.risk.unsafe).tolist() == [0]
    assert world.budget([Saw(0, 0), Took(0), Took(0)]).budgets[0] == 0.0


def test_what_is_not_settled_is_charged_by_the_models_credible_after_a_change() -> None:
    world = place(CORRIDOR, 0.5, 7)
    budget = world.budget([Saw(0, 0), Took(0), Saw(1, 1), Took(0)])
    worse: Sets = {**CORRIDOR, 1: {0: [{2: 0.7, 6: 0.3}, {1: 1.0}], 1: [{1: 1.0}]}}
    sets = make_sets(worse, {6}, num_states=7)
    assert budget.budgets[2] == pytest.approx(0.3)
    budget.renew(robust_risk(sets), sets)
    # 0.1 is settled and stays spent; the step from 1 cost 0.3, and may have led nowhere.
    assert budget.budgets[2] == pytest.approx(0.1)
    assert budget.states(world.risk.unsafe).tolist() == [1, 2]


def test_where_ways_meet_the_one_that_cost_more_counts() -> None:
    choices: Sets = {
        0: {0: [{1: 0.5, 2: 0.5}], 1: [{0: 1.0}]},
        1: {0: [{1: 1.0}], 1: [{0: 0.6, 3: 0.4}]},
        2: {0: [{2: 1.0}], 1: [{0: 0.9, 3: 0.1}]},
    }
    hidden = place(choices, 0.5).budget([Saw(0, 0), Took(0), Took(1)])
    assert hidden.budgets[0] == pytest.approx(0.1)


def test_while_the_episode_goes_on_the_task_is_not_complete() -> None:
    """State 2 has no actions: had it got there, nothing more would be done."""
    choices: Sets = {0: {0: [{1: 0.5, 2: 0.5}]}, 1: {0: [{1: 1.0}]}}
    world = place(choices, 0.1)
    assert world.budget([Saw(0, 0), Took(0)]).states(world.risk.unsafe).tolist() == [1]
    assert world.allowed([Saw(0, 0), Took(0)]) == ([0], False)
    assert world.budget([]).states(world.risk.unsafe).tolist() == [0, 1]
