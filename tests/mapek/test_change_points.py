from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from merap.belief.posterior import Belief, prior_belief
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.belief.update import observe_step
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.mapek.change_points import CHANGE_POINTS, UNEXPLAINED, ChangePoints
from tests.support.belief_routes import STRIP, Seen, joint, trajectory
from tests.support.case_examples import write_case

NOISE = 0.3


@pytest.fixture
def case(tmp_path: Path) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path, STRIP))


def after(space: HypothesisSpace, belief: Belief, seen: list[Seen]) -> Belief:
    for one in seen:
        belief = observe_step(space, belief, one.step)
    return belief


@pytest.mark.parametrize("seed", range(5))
def test_the_odds_are_those_of_bayes(case: DeclaredCase, seed: int) -> None:
    """Second route: p(new | prior) = prior(h) p(new | h) / p(h | new) for every hypothesis h of the base, and
    likewise with what was seen before in the place of the prior; the ratio of both needs no likelihood.
    """
    generator = np.random.default_rng(seed)
    space = hypothesis_space(case, noise=NOISE)
    seen = trajectory(case.combination_at(int(generator.integers(case.size))), 14, NOISE, generator)
    whole = after(space, prior_belief(space), seen[:7])
    points = ChangePoints(space)
    points.add(0, whole)
    learned = after(space, whole, seen[7:])
    points.update(lambda belief: after(space, belief, seen[7:]))
    point = points.best(learned)
    assert point is not None
    environments, capabilities, objectives = case.shape
    shares = [
        joint(space, belief)[:environments, :capabilities, :, :objectives]
        for belief in (prior_belief(space), point.belief, learned, whole)
    ]
    prior, told, both, before = (share[np.all([one > 0 for one in shares], axis=0)] for share in shares)
    assert len(prior)
    expected = np.log(prior) - np.log(told) + np.log(both) - np.log(before)
    np.testing.assert_allclose(point.log_odds(learned), expected, atol=1e-8)


def test_a_change_is_more_likely_than_what_was_learned(case: DeclaredCase) -> None:
    """The goal is moved after 60 steps."""
    space = hypothesis_space(case, noise=NOISE)
    there, moved = (case.combine(0, 0, number) for number in (0, 1))
    generator = np.random.default_rng(1)
    before = trajectory(there, 60, NOISE, generator)
    whole = after(space, prior_belief(space), before)
    same, other = ChangePoints(space), ChangePoints(space)
    for points, actual in ((same, there), (other, moved)):
        points.add(3, whole)
        seen = trajectory(actual, 40, NOISE, generator)
        points.update(partial(after, space, seen=seen))
        found = points.convincing(after(space, whole, seen))
        assert (found is None) == (actual is there)
        assert found is None or found.episode == 3


def test_what_no_hypothesis_allows_counts_against_who_holds_it_impossible(case: DeclaredCase) -> None:
    """What is impossible after all that was seen, but not at first."""
    space = hypothesis_space(case, noise=NOISE)
    whole = prior_belief(space)
    points = ChangePoints(space)
    points.add(0, whole)
    strange = replace(whole, unexplained=2)
    point = points.best(strange)
    assert point is not None
    assert point.log_odds(strange) == pytest.approx(-2 * UNEXPLAINED)


def test_only_the_last_episodes_are_tried(case: DeclaredCase) -> None:
    space = hypothesis_space(case, noise=NOISE)
    points = ChangePoints(space)
    assert points.best(prior_belief(space)) is None
    # the earlier an episode, the better the odds would be, if it were still there
    for episode in range(CHANGE_POINTS + 2):
        points.add(episode, replace(prior_belief(space), evidence=-float(episode)))
    best = points.best(prior_belief(space))
    assert best is not None
    assert best.episode == 2
    assert best.log_odds(prior_belief(space)) == pytest.approx(-2)


@pytest.mark.slow
def test_without_a_change_the_odds_stay_low(case: DeclaredCase) -> None:
    """Of 200 systems drawn from the base none may reach e^7 within three episodes: by Ville each does with
    a chance of e^-7 for each change point, 0.18 for all of them; the seed is fixed."""
    space = hypothesis_space(case, noise=NOISE)
    generator = np.random.default_rng(0)
    highest = -np.inf
    for _ in range(200):
        actual = case.combination_at(int(generator.integers(case.size)))
        belief, points = prior_belief(space), ChangePoints(space)
        for episode in range(3):
            points.add(episode, belief)
            for one in trajectory(actual, 8, NOISE, generator):
                belief = after(space, belief, [one])
                points.update(partial(after, space, seen=[one]))
                best = points.best(belief)
                assert best is not None
                highest = max(highest, best.log_odds(belief))
    assert highest < 7
