"""What no detector can do better, against closed forms and draws."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import norm

from merap.mdp.assembly import sum_by
from merap.mdp.model import Floats, TabularMDP
from scripts.bench.trigger_bound import Ratio, most_in_time, nats_per_episode, power, ratio, visits
from scripts.bench.trigger_delay import Change, World, change_delays, watch
from scripts.bench.trigger_streams import Known, effect, gaussian, known, placed, stream
from tests.support.hand_made import cells, grid_combination

WORLD = World(slip=0.1, noise=0.5)
GOAL = (2, 2)


@cache
def before() -> Known:
    return known(grid_combination(goal=GOAL), WORLD.slip)


def worn(slip: float) -> TabularMDP:
    return placed(grid_combination(goal=GOAL), slip)


def paying(model: TabularMDP, value: float) -> TabularMDP:
    """A goal that pays another value than 10."""
    assert model.branch_reward is not None
    return replace(
        model,
        branch_reward=np.where(model.branch_reward == 10, value, model.branch_reward),
        choice_reward=np.where(model.choice_reward == 10, value, model.choice_reward),
    )


def change_to(real: TabularMDP) -> Ratio:
    return ratio(before().model, real, WORLD.noise)


def logs_of_episodes(change: Ratio, count: int, seed: int) -> Floats:
    steps = stream(before(), change.real, count, gaussian(WORLD.noise), np.random.default_rng(seed))
    return sum_by(np.cumsum(steps.last) - steps.last, change.logs(steps), count)


def test_more_slip_tells_the_same_in_every_step_that_moves() -> None:
    """Four steps to the goal take 4 / 0.7 tries on average (18 are nearly always enough), stop one."""
    each = 0.3 * np.log(0.3 / 0.1) + 0.7 * np.log(0.7 / 0.9)
    assert visits(before(), worn(0.3)).sum() == pytest.approx(4 / 0.7 + 1, abs=1e-3)
    assert nats_per_episode(before(), change_to(worn(0.3))) == pytest.approx(each * 4 / 0.7, abs=1e-3)


def test_a_goal_that_pays_less_tells_the_square_of_what_is_missing() -> None:
    """9 instead of 10 with noise of 0.5: 1^2 / (2 * 0.5^2) = 2 nats, where the goal is reached."""
    change = change_to(paying(before().model, 9.0))
    assert nats_per_episode(before(), change) == pytest.approx(2.0, abs=1e-6)


def test_what_is_not_visited_tells_nothing_and_the_impossible_everything() -> None:
    far = change_to(placed(grid_combination(blocked=cells((8, 8)), goal=GOAL), WORLD.slip))
    assert nats_per_episode(before(), far) == 0.0
    (seen,) = most_in_time(before(), far, 3, (1e-3,), np.random.default_rng(0))
    assert seen == pytest.approx(3 * 1e-3 * (4 / 0.9 + 1), abs=1e-3)
    # without slip a step that fails is impossible
    sure = known(grid_combination(goal=GOAL), 0.0)
    slips = ratio(sure.model, worn(0.5), WORLD.noise)
    assert nats_per_episode(sure, slips) == np.inf
    # each episode slips at least once, but for 1 of 2^4
    (seen,) = most_in_time(sure, slips, 3, (1e-9,), np.random.default_rng(0))
    assert seen == pytest.approx(1 - 2.0**-12, abs=2e-3)


@pytest.mark.parametrize("what", ["slip", "reward"])
def test_draws_have_the_exact_mean_and_are_likelihood_ratios(what: str) -> None:
    """4 standard errors each: luck fails the test once in 8000 seeds; these are fixed."""
    change = change_to(worn(0.2) if what == "slip" else paying(before().model, 9.5))
    logs = logs_of_episodes(change, 4000, seed=1)
    assert abs(logs.mean() - nats_per_episode(before(), change)) < 4 * logs.std() / np.sqrt(4000)
    inverse = np.exp(-logs)
    assert abs(inverse.mean() - 1) < 4 * inverse.std() / np.sqrt(4000)


@pytest.mark.parametrize("size", [0.1, 1e-3, 1e-6])
def test_the_power_for_a_normal_mean(size: float) -> None:
    """A shift of m deviations: the ratio's logarithm is N(m^2 / 2, m^2), the power Phi(m - z).

    Twice the standard error of the power at 0.5, for both it and the size: luck is far outside.
    """
    shift = norm.isf(size) + 0.5
    logs = np.random.default_rng(2).normal(shift**2 / 2, shift, 20_000)
    assert power(logs, size) == pytest.approx(norm.cdf(0.5), abs=0.02)


def test_no_detector_sees_more() -> None:
    """The detector with at most 1 in 300 steps; both are drawn, with standard errors of 3 % and 1 %."""
    real = worn(0.5)
    change = Change("", before(), before().model, real, effect(before(), real))
    watched = watch(change, WORLD, 200, 10, np.random.default_rng(3))
    seen = (change_delays(watched, WORLD.settings, log_threshold=np.log(300)) <= 3).mean()
    (bound,) = most_in_time(before(), change_to(real), 3, (1 / 300,), np.random.default_rng(4))
    assert 0.3 < seen <= bound + 0.1
    assert bound < 1
