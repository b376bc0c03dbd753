"""Masks for policies without memory: risk of a policy, and the widest mask within a threshold."""

from __future__ import annotations

import numpy as np
import pytest

from merap.mdp.model import Floats
from merap.shield.fixpoint import robust_risk
from merap.shield.policy import masked_policy, policy_risk, slack_mask
from tests.support.shield_examples import Sets, make_sets, random_sets

# Each step beside the hole risks 0.1; waiting risks nothing.
EDGE = make_sets({0: {0: [{0: 0.9, 1: 0.1}], 1: [{0: 1.0}]}}, {1}, num_states=2)
START = np.array([1.0, 0.0])


def enumerated(choices: Sets, policy: Floats, state: int, steps: int) -> float:
    """The greatest probability to reach state 3 under a policy, by recursion over nature's picks."""
    if state == 3:
        return 1.0
    if steps == 0:
        return 0.0
    return sum(
        float(policy[state, action])
        * max(
            sum(prob * enumerated(choices, policy, successor, steps - 1) for successor, prob in one.items())
            for one in distributions
        )
        for action, distributions in choices[state].items()
    )


@pytest.mark.parametrize("seed", range(10))
def test_the_risk_of_a_policy_is_the_worst_over_models(seed: int) -> None:
    generator = np.random.default_rng(seed)
    choices, sets = random_sets(generator)
    policy = generator.dirichlet(np.ones(2), size=4)
    found = policy_risk(sets, policy, 4)
    for state in range(4):
        assert found[state] == pytest.approx(enumerated(choices, policy, state, 4), abs=1e-12)
    by_time = policy_risk(sets, np.repeat(policy[np.newaxis], 4, axis=0), 4)
    np.testing.assert_allclose(by_time, found, atol=1e-15)


def test_relying_on_an_unsure_action_counts_with_the_worst_of_the_others() -> None:
    choices: Sets = {0: {0: [{0: 1.0}], 1: [{0: 0.6, 1: 0.4}]}}
    sets = make_sets(choices, {1}, num_states=2, unsure={(0, 0)})
    half = np.array([[0.5, 0.5], [0.5, 0.5]])
    # If action 0 turns out disabled, all of the policy is action 1.
    assert policy_risk(sets, half, 1)[0] == pytest.approx(0.4)
    assert policy_risk(make_sets(choices, {1}, num_states=2), half, 1)[0] == pytest.approx(0.2)


@pytest.mark.parametrize("seed", range(15))
@pytest.mark.parametrize("threshold", [0.0, 0.1, 0.4])
def test_a_masked_policy_keeps_the_threshold(seed: int, threshold: float) -> None:
    generator = np.random.default_rng(seed)
    _, sets = random_sets(generator)
    risk = robust_risk(sets, precision=1e-13)
    policy = generator.dirichlet(np.ones(2), size=4)
    start = np.eye(4)[0]
    masked = masked_policy(sets, risk, policy, start, threshold, 6)
    promised = max(threshold, float(risk.of_states[0]))
    assert policy_risk(sets, masked, 6)[0] <= promised + 1e-9
    if policy_risk(sets, policy, 6)[0] <= promised:
        # A policy that needs no mask is left alone.
        np.testing.assert_allclose(masked, policy, atol=1e-12)


def test_a_policy_may_risk_more_at_once_than_an_equal_share_of_each_step() -> None:
    risk = robust_risk(EDGE)
    once = np.zeros((5, 2, 2))
    once[:, :, 1] = 1.0
    once[2, 0] = (1.0, 0.0)
    # One step at 0.1 in five: the whole threshold, where an equal share would be 0.02 a step.
    np.testing.assert_array_equal(masked_policy(EDGE, risk, once, START, 0.1, 5), once)
    always = np.tile([1.0, 0.0], (5, 2, 1))
    careful = masked_policy(EDGE, risk, always, START, 0.1, 5)
    assert careful[:, 0].tolist() == [[0.0, 1.0]] * 5


def test_a_threshold_of_zero_allows_what_is_certain() -> None:
    risk = robust_risk(EDGE)
    assert slack_mask(risk, 0.0).tolist() == [[False, True], [True, True]]
