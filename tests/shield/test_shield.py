"""The shield as a strategy or a loop uses it: what is allowed, what is reported, the mask of a policy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merap.errors import InputError
from merap.shield.shield import RobustShield, shielded_policy
from tests.support.shield_examples import make_sets

# From 0 across a ledge to 1, which slips by 0.1 or, if it rains, by 0.3; waiting is safe.
DRY = make_sets({0: {0: [{1: 0.9, 2: 0.1}], 1: [{0: 1.0}]}, 1: {0: [{1: 1.0}]}}, {2}, num_states=3)
ANY = make_sets(
    {0: {0: [{1: 0.9, 2: 0.1}, {1: 0.7, 2: 0.3}], 1: [{0: 1.0}]}, 1: {0: [{1: 1.0}]}}, {2}, num_states=3
)
BOTH = np.ones(2, dtype=np.bool_)


def begin(shield: RobustShield, state: int = 0) -> None:
    shield.begin()
    shield.seen(state)


def step(shield: RobustShield, action: int, state: int) -> None:
    shield.took(action)
    shield.seen(state)


def test_it_loosens_and_tightens_with_what_is_credible() -> None:
    credible = [ANY]
    shield = RobustShield(lambda: credible[0], 0.2)
    begin(shield)
    assert shield.allowed(BOTH).tolist() == [False, True]
    credible[0] = DRY
    assert shield.refresh()
    assert shield.allowed(BOTH).tolist() == [True, True]
    credible[0] = ANY
    assert shield.refresh()
    assert not shield.refresh()
    assert shield.allowed(BOTH).tolist() == [False, True]
    report = shield.report()
    assert (report.changes, report.steps, report.withheld, report.fallbacks) == (2, 3, 2, 0)


def test_the_budget_goes_with_the_steps_of_an_episode() -> None:
    shield = RobustShield(lambda: DRY, 0.15)
    begin(shield)
    assert shield.allowed(BOTH).tolist() == [True, True]
    step(shield, 1, 0)
    assert shield.budgets[0] == 0.15
    step(shield, 0, 1)
    assert shield.budgets[1] == pytest.approx(0.05)
    begin(shield)
    assert shield.budgets[0] == 0.15
    assert shield.report().episodes == 2
    assert shield.report().worst_risk == pytest.approx(0.1)


def test_a_step_is_charged_what_it_risked_when_it_was_allowed() -> None:
    credible = [ANY]
    shield = RobustShield(lambda: credible[0], 0.4)
    begin(shield)
    assert shield.allowed(BOTH).tolist() == [True, True]
    shield.took(0)
    # That the ledge held speaks for a dry one; it was crossed at 0.3 all the same.
    credible[0] = DRY
    shield.refresh()
    shield.seen(1)
    assert shield.budgets[1] == pytest.approx(0.1)


def test_an_empty_set_is_reported_and_never_returned() -> None:
    forced = make_sets(
        {0: {0: [{1: 0.9, 2: 0.1}], 1: [{1: 0.6, 2: 0.4}]}, 1: {0: [{1: 1.0}]}}, {2}, num_states=3
    )
    shield = RobustShield(lambda: forced, 0.05)
    begin(shield)
    assert shield.allowed(BOTH).tolist() == [True, False]
    step(shield, 0, 1)
    assert shield.allowed(np.array([True, False])).tolist() == [True, False]
    report = shield.report().as_dict()
    assert report == {
        "threshold": 0.05,
        "episodes": 1,
        "steps": 2,
        "beyond_from_start": 1,
        "fallbacks": 1,
        "withheld": 1,
        "worst_risk": pytest.approx(0.1),
        "changes": 0,
    }


def test_an_action_that_no_credible_model_has_is_the_last_resort() -> None:
    shield = RobustShield(lambda: DRY, 0.5)
    begin(shield, 1)
    assert shield.allowed(BOTH).tolist() == [True, False]
    assert shield.allowed(np.array([False, True])).tolist() == [False, True]
    assert shield.report().fallbacks == 1


@pytest.mark.parametrize("threshold", [-0.1, 1.1, float("nan")])
def test_a_threshold_that_is_no_probability_is_refused(threshold: float) -> None:
    with pytest.raises(InputError, match=r"must be in \[0, 1\]"):
        RobustShield(lambda: DRY, threshold)


@given(st.integers(0, 2**32 - 1))
def test_a_shielded_policy_is_a_distribution_within_the_mask(seed: int) -> None:
    generator = np.random.default_rng(seed)
    policy = generator.dirichlet(np.ones(4), size=(3, 5)) * (generator.random((3, 5, 4)) < 0.6)
    mask = generator.random((5, 4)) < 0.5
    masked = shielded_policy(policy, mask)
    some = np.asarray(mask.any(axis=1))
    np.testing.assert_allclose(masked[:, some].sum(axis=-1), 1, atol=1e-12)
    assert not masked[:, ~mask & some[:, np.newaxis]].any()
    np.testing.assert_array_equal(masked[:, ~some], policy[:, ~some])
    for t, s in np.argwhere((policy * mask).sum(axis=-1) > 0):
        kept = np.flatnonzero(policy[t, s] * mask[s])
        ratio = masked[t, s, kept] / policy[t, s, kept]
        np.testing.assert_allclose(ratio, ratio[0])
