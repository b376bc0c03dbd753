"""E-values: their mean is at most 1 while the model holds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from merap.online.trigger.evidence import REWARD_DROPS, log_evidence


def evidence_of(residual: float, cap: float = 100.0) -> list[float]:
    (row,) = np.exp(log_evidence(np.zeros(1), np.zeros((1, 1)), np.array([residual]), cap))
    return list(map(float, row[1:]))


@pytest.mark.parametrize("number", range(len(REWARD_DROPS)))
def test_the_mean_over_gaussian_noise_is_1(number: int) -> None:
    mean, _ = quad(lambda z: evidence_of(z)[number] * norm.pdf(z), -14, 10, epsabs=1e-9, limit=200)
    assert mean == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("number", range(len(REWARD_DROPS)))
def test_noise_that_is_larger_than_stated_breaks_it_and_a_cap_only_lowers_it(number: int) -> None:
    """Stated half of what it is: the mean of exp(-d z - d^2 / 2) is exp(3 d^2 / 2) with z of deviation 2."""
    drop = REWARD_DROPS[number]
    wide, _ = quad(lambda z: evidence_of(z)[number] * norm.pdf(z, scale=2), -40, 20, epsabs=1e-9, limit=400)
    expected = 1 - drop.share + drop.share * math.exp(1.5 * drop.deviations**2)
    assert wide == pytest.approx(expected, rel=1e-4)
    capped, _ = quad(
        lambda z: evidence_of(z, 3.0)[number] * norm.pdf(z, scale=2), -40, 20, epsabs=1e-9, limit=400
    )
    assert capped < wide


def test_transitions_are_likelihood_ratios_cut_to_the_cap() -> None:
    found = log_evidence(
        np.log([0.5, 1e-6]), np.log([[0.25, 0.5], [0.25, 0.5]]), np.zeros(2), max_evidence=8.0
    )
    np.testing.assert_allclose(found[:, :2], [[math.log(0.5), 0.0], [8.0, 8.0]])


def test_a_lower_reward_is_evidence_and_a_higher_one_is_not() -> None:
    low, high = evidence_of(-5.0), evidence_of(5.0)
    assert all(value > 1 for value in low)
    assert all(value < 1 for value in high)
