"""The budget: exact probabilities of a violation, over all histories of small models."""

from __future__ import annotations

import numpy as np
import pytest

from merap.mdp.model import Bools
from merap.shield.budget import permitted, spent
from merap.shield.fixpoint import Risk, robust_risk
from tests.support.shield_examples import Sets, make_sets, random_sets

# Each step beside the hole risks 0.1; waiting risks nothing.
EDGE: Sets = {0: {0: [{0: 0.9, 1: 0.1}], 1: [{0: 1.0}]}}


def worst_history(
    choices: Sets, risk: Risk, threshold: float, state: int, budget: float, steps: int
) -> float:
    """The greatest probability of a violation that nature and any allowed behaviour reach.

    By recursion over all histories: whoever acts takes the worst action that is allowed, nature the
    worst distribution.
    """
    if risk.unsafe[state]:
        return 1.0
    if steps == 0:
        return 0.0
    enabled = np.isin(np.arange(risk.of_actions.shape[1]), list(choices[state]))
    mask, _ = permitted(risk, np.array([state]), np.array([budget]), enabled)
    worst = 0.0
    for action in np.flatnonzero(mask).tolist():
        for distribution in choices[state][action]:
            total = 0.0
            for successor, prob in distribution.items():
                left = float(spent(risk, threshold, state, action, successor, budget))
                total += prob * worst_history(choices, risk, threshold, successor, left, steps - 1)
            worst = max(worst, total)
    return worst


def test_a_threshold_on_single_steps_does_not_bound_an_episode() -> None:
    # Ten steps, each allowed by itself at 0.1, add up to 1 - 0.9^10 = 0.65; with the budget of 0.1 the
    # first step spends it all.
    risk = robust_risk(make_sets(EDGE, {1}, num_states=2))
    assert bool((risk.of_actions[0] <= 0.1).all())
    assert 1 - 0.9**10 > 0.65
    assert worst_history(EDGE, risk, 0.1, 0, 0.1, 10) == pytest.approx(0.1)
    # 0.25 is enough for one step (0.1) and a second, but not for a third: 1 - 0.9^2.
    assert worst_history(EDGE, risk, 0.25, 0, 0.25, 10) == pytest.approx(1 - 0.9**2)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("threshold", [0.0, 0.05, 0.3])
def test_no_behaviour_within_the_budget_exceeds_it(seed: int, threshold: float) -> None:
    choices, sets = random_sets(np.random.default_rng(seed))
    risk = robust_risk(sets, precision=1e-14)
    choices = {**choices, 3: {0: [{3: 1.0}]}}
    promised = max(threshold, float(risk.of_states[0]))
    worst = worst_history(choices, risk, threshold, 0, promised, 5)
    assert worst <= promised + 1e-9
    if promised == 0:
        assert worst == 0


def at_zero(risk: Risk, budget: float, enabled: Bools) -> tuple[Bools, Bools]:
    return permitted(risk, np.zeros(1, dtype=np.int64), np.array([budget]), enabled)


def test_where_nothing_is_within_the_budget_the_least_risky_is_left() -> None:
    sets = make_sets({0: {0: [{0: 0.5, 1: 0.5}], 1: [{0: 0.8, 1: 0.2}]}}, {1}, num_states=2)
    risk = robust_risk(make_sets(EDGE, {1}, num_states=2))
    both: Bools = np.ones(2, dtype=np.bool_)
    assert at_zero(risk, 0.0, both)[0].tolist() == [False, True]
    mask, none = at_zero(risk, 0.0, np.array([True, False]))
    assert (mask.tolist(), bool(none)) == ([True, False], True)
    # Here every behaviour falls in the end, so that no budget below 1 is enough.
    mask, none = at_zero(robust_risk(sets), 0.5, both)
    assert bool(none)
    assert mask.any()


def test_a_violation_begins_a_new_budget() -> None:
    risk = robust_risk(make_sets(EDGE, {1}, num_states=2))
    assert float(spent(risk, 0.2, 0, 0, 1, 0.15)) == 0.2


def test_episodes_side_by_side_are_as_one_by_one() -> None:
    generator = np.random.default_rng(3)
    _, sets = random_sets(generator, num_states=6, num_actions=3)
    risk = robust_risk(sets)
    state = generator.integers(0, 5, size=50)
    budget = generator.uniform(0, 0.5, size=50)
    enabled = generator.random((50, 3)) < 0.7
    enabled[:, 0] = True
    mask, none = permitted(risk, state[:, np.newaxis], budget[:, np.newaxis], enabled)
    action = mask.argmax(axis=1)
    left = spent(risk, 0.1, state, action, np.roll(state, 1), budget)
    for b in range(50):
        alone, beyond = permitted(risk, state[b : b + 1], budget[b : b + 1], enabled[b])
        assert (alone.tolist(), bool(beyond)) == (mask[b].tolist(), bool(none[b]))
        after = spent(risk, 0.1, int(state[b]), int(action[b]), int(np.roll(state, 1)[b]), float(budget[b]))
        assert float(after) == left[b]
