"""Evidence of a change at one state and action alone, against Bayes' rule by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.mdp.model import Floats
from merap.trigger.local import LocalOdds
from scripts.bench.trigger_batch import local_evidence

CHANCE = 0.02


def observed(place: list[int], log_ratios: Floats, chance: float = CHANCE) -> list[float]:
    odds = LocalOdds(chance)
    return [odds.observe(one, ratios) for one, ratios in zip(place, log_ratios, strict=True)]


def test_the_product_is_that_of_a_mixture_over_when_and_how_a_place_changed() -> None:
    """No change, or before visit t in way h, with prior (1 - c)^t c / H."""
    ratios = np.random.default_rng(0).uniform(0.2, 4.0, (6, 2))
    by_hand = (1 - CHANCE) ** 6
    for visit in range(6):
        for way in range(2):
            by_hand += (1 - CHANCE) ** visit * CHANCE / 2 * ratios[visit:, way].prod()
    assert sum(observed([3] * 6, np.log(ratios))) == pytest.approx(math.log(by_hand))


@pytest.mark.parametrize("visits", [0, 1, 20])
def test_the_mean_is_1_if_that_of_each_ratio_is(visits: int) -> None:
    """Two outcomes, 0.9 and 0.1 under the model: 30 and 3 times the odds of the second."""
    prob = np.array([0.9, 0.1])
    ratios = np.array([[9 / 39 / 0.9, 9 / 12 / 0.9], [30 / 39 / 0.1, 3 / 12 / 0.1]])
    history = [ratios[outcome] for outcome in np.random.default_rng(1).integers(2, size=visits)]
    mean = sum(
        weight * math.exp(observed([0] * (visits + 1), np.log([*history, ratios[outcome]]))[-1])
        for outcome, weight in enumerate(prob)
    )
    assert mean == pytest.approx(1.0)


def test_what_is_learned_of_a_place_counts_there_alone() -> None:
    """A second surprise says nearly as much as its likelihood ratio at the same place, little at another."""
    surprise = np.full((6, 2), math.log(7.0))
    same, spread = observed([0] * 6, surprise), observed([0, 1, 2, 3, 4, 5], surprise)
    assert same[-1] == pytest.approx(math.log(7.0), abs=0.1)
    assert spread == pytest.approx([math.log1p(6 * CHANCE)] * 6)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), chance=st.floats(1e-6, 0.5), length=st.integers(1, 80))
def test_cumulated_sums_agree(seed: int, chance: float, length: int) -> None:
    drawn = np.random.default_rng(seed)
    place, log_ratios = drawn.integers(-1, 4, length), drawn.normal(-0.5, 2.0, (length, 3))
    expected = observed(place.tolist(), log_ratios, chance)
    np.testing.assert_allclose(local_evidence(place, log_ratios, chance), expected, rtol=1e-9, atol=1e-9)
