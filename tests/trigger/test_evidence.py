"""E-values: their mean is at most 1 while the model holds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as checked
from hypothesis import strategies as st
from scipy.stats import norm, t

from merap.mdp.model import Floats
from merap.trigger.evidence import GAUSSIAN, SYMMETRIC, log_evidence, num_kinds
from merap.trigger.settings import ChangeSettings

STATED = ChangeSettings(noise=0.5, odds=(1.0,), max_evidence=100.0)
ANY = STATED.model_copy(update={"tails": "symmetric"})


def evidence_of(deviation: Floats, settings: ChangeSettings = STATED) -> Floats:
    """[M, K - 2], of the rewards, where they are off by so many standard deviations of 0.5."""
    zeros = np.zeros(len(deviation))
    rows = np.exp(log_evidence(zeros, zeros[:, np.newaxis], zeros, 0.5 * deviation, settings))
    assert rows.shape == (len(deviation), num_kinds(settings))
    rewards: Floats = rows[:, 2:]
    return rewards


def mean_of(
    number: int, density: Callable[[Floats], Floats], settings: ChangeSettings = STATED, reach: float = 40.0
) -> float:
    """By the trapezoidal rule, whose error for smooth densities is far below 10^-9 here."""
    points = np.linspace(-reach, reach, 200_001)
    return float(np.trapezoid(evidence_of(points, settings)[:, number] * density(points), points))


@pytest.mark.parametrize("number", range(len(GAUSSIAN)))
def test_the_mean_over_gaussian_noise_is_1(number: int) -> None:
    assert mean_of(number, norm.pdf) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("number", range(len(GAUSSIAN)))
def test_noise_that_is_larger_than_stated_breaks_it_and_a_cap_only_lowers_it(number: int) -> None:
    """Stated half of what it is: the mean of exp(-d z - d^2 / 2) is exp(3 d^2 / 2) with z of deviation 2."""
    drop = GAUSSIAN[number]
    wide = mean_of(number, lambda z: norm.pdf(z, scale=2))
    assert wide == pytest.approx(1 - drop.share + drop.share * np.exp(1.5 * drop.deviations**2), rel=1e-4)
    capped = STATED.model_copy(update={"max_evidence": 3.0})
    assert mean_of(number, lambda z: norm.pdf(z, scale=2), capped) < wide


@pytest.mark.parametrize("number", range(len(SYMMETRIC)))
@pytest.mark.parametrize("scale", [0.1, 1.0, 5.0])
def test_any_symmetric_noise_keeps_the_mean_at_most_1(number: int, scale: float) -> None:
    """Student's t with three degrees of freedom, and normal noise, of any size."""
    assert mean_of(number, lambda z: t.pdf(z, 3, scale=scale), ANY) <= 1
    assert mean_of(number, lambda z: norm.pdf(z, scale=scale), ANY) <= 1


@checked(deadline=None)
@given(deviation=st.floats(0, 1e6))
def test_two_values_that_are_equally_likely_keep_it_too(deviation: float) -> None:
    """Every symmetric distribution is a mixture of these; and no step says more than half a nat."""
    both = evidence_of(np.array([-deviation, deviation]), ANY)
    assert np.all(both.mean(axis=0) <= 1)
    assert np.all(both <= np.exp(0.5) * (1 + 1e-12))


def test_transitions_are_likelihood_ratios_cut_to_the_cap() -> None:
    settings = ChangeSettings(odds=(1.0, 2.0), max_evidence=8.0)
    local = np.array([1.0, 9.0])
    found = log_evidence(
        np.log([0.5, 1e-6]), np.log([[0.25, 0.5], [0.25, 0.5]]), local, np.zeros(2), settings
    )
    np.testing.assert_allclose(found[:, :3], [[np.log(0.5), 0.0, 1.0], [8.0, 8.0, 8.0]])


@pytest.mark.parametrize("settings", [STATED, ANY])
def test_a_lower_reward_is_evidence_and_a_higher_one_is_not(settings: ChangeSettings) -> None:
    low, high = evidence_of(np.array([-1.0, 1.0]), settings)
    assert low.max() > 1
    assert high.max() < 1
