"""The updated prior is a mixture, in which the posterior has half of the weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.belief.outside import Outside
from merap.belief.posterior import prior_belief
from merap.belief.prior_update import SHARE, base_weight, likeliest, updated_prior
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.case_study import load_declared_case


@pytest.fixture(scope="module")
def space() -> HypothesisSpace:
    return hypothesis_space(load_declared_case("models/paper-grid/rq1-5.yaml"))


def test_the_new_prior_is_a_mixture(space: HypothesisSpace) -> None:
    certain = np.full_like(space.objective_prior, -np.inf)
    certain[-1] = 0.0
    belief = prior_belief(replace(space, objective_prior=certain))
    found = updated_prior(space, belief)
    before, after = np.exp(space.objective_prior), np.exp(found.objective_prior)
    assert after.sum() == pytest.approx(1)
    assert after[-1] == pytest.approx(SHARE + (1 - SHARE) * before[-1])
    np.testing.assert_allclose(after[:-1], (1 - SHARE) * before[:-1])
    # Of the dynamics nothing was learned, so nothing is different.
    np.testing.assert_allclose(found.prior, space.prior)


def test_the_weight_of_the_base_is_what_the_prior_leaves_it(space: HypothesisSpace) -> None:
    declared = Outside()
    share = base_weight(space, prior_belief(space))
    inside = np.exp(space.objective_prior[: space.num_objectives]).sum()
    assert share <= inside
    assert share <= (1 - declared.environment) * (1 - declared.capability)
    assert share > 0.5


def test_the_likeliest_is_named(space: HypothesisSpace) -> None:
    certain = np.full_like(space.objective_prior, -np.inf)
    certain[-1] = 0.0
    named = likeliest(space, prior_belief(replace(space, objective_prior=certain)))
    assert named[2] == space.objective_names[-1]
    assert named[0] == "open"
