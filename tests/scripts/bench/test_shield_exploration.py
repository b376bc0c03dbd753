"""Many robots side by side: what the shield prevents, what it costs, and the numbers' own routes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from merap.concerns.case_study import load_declared_case
from merap.mdp.evaluation import expected_return
from merap.mdp.model import TabularMDP
from scripts.bench.shield_exploration import Habits, explore, rate_limit
from scripts.bench.shield_quality import SETTINGS, shield_figures
from tests.support.mdp_examples import make_mdp
from tests.support.paths import MODELS

EPISODES = 2_000


@cache
def figures(case: str, system: str, thresholds: tuple[float, ...]) -> list[dict[str, Any]]:
    return list(shield_figures(load_declared_case(MODELS / case), system, thresholds, EPISODES))


@pytest.mark.parametrize(
    ("case", "system"), [("hazard-grid", "met"), ("running-example", "c_blocked.speed_high.g1")]
)
def test_no_violation_where_none_need_be(case: str, system: str) -> None:
    alone, kept = figures(case, system, (0.0,))
    # Measured over 10,000 episodes: 0.375 and 0.074 without a shield. None at all in 2,000 would have a
    # chance below 1e-60.
    assert alone["violations"] > 0
    assert kept["violations"] == 0
    assert kept["fallback_steps"] == 0
    # A robot that waits is no success: with what the first episodes told nearly all get to the goal.
    assert kept["goal_rate_last"] > 0.9
    assert kept["robots_never_at_goal"] < 0.1 * min(500, EPISODES)
    # The belief loosens the shield: fewer models are credible, more robots arrive.
    assert kept["credible_models_last"] < kept["credible_models_first"]
    assert kept["goal_rate_last"] >= kept["goal_rate_first"]


def test_a_threshold_keeps_the_rate_of_violations_below_it() -> None:
    alone, none, some = figures("hazard-grid", "island", (0.0, 0.25))
    # Every way to this goal risks a slide to both sides, at worst 0.2: at 0 nobody gets there, and no
    # shield is at fault. True rate at 0.25: 0.09 (10,000 episodes); a limit above 0.25 would be a matter
    # of 24 standard errors.
    assert (none["violations"], none["goal_rate"]) == (0, 0.0)
    assert 0 < some["violation_limit"] < 0.25
    assert some["goal_rate_last"] > 0.4
    assert alone["violation_rate"] > some["violation_rate"]


def test_the_settings_of_the_bench_are_there() -> None:
    for setting in SETTINGS:
        assert load_declared_case(MODELS / setting.case).system(setting.system).objective.unsafe is not None


@pytest.mark.parametrize(("count", "trials"), [(0, 10_000), (3, 50), (50, 50), (120, 1000)])
def test_the_limit_is_that_of_clopper_and_pearson(count: int, trials: int) -> None:
    interval = binomtest(count, trials).proportion_ci(0.95, method="exact")
    assert rate_limit(count, trials) == pytest.approx(interval.high, abs=1e-12)


def ledge(slip: float) -> TabularMDP:
    """Across a ledge to the goal, or around it in two steps."""
    return make_mdp(
        {
            (0,): {"across": (-1.0, {(2,): 1 - slip, (3,): slip}), "around": (-1.5, {(1,): 1.0})},
            (1,): {"around": (-1.5, {(2,): 1.0})},
            (2,): {"around": (10.0, {(4,): 1.0})},
            (3,): {"around": (0.0, {(3,): 1.0})},
            (4,): {"end": (0.0, {(4,): 1.0})},
        },
        actions=("across", "around", "end"),
        labels={"unsafe": {(3,)}, "done": {(4,)}},
    )


def test_the_robots_follow_the_model_that_is_there() -> None:
    # One known model, no trying: 4,000 robots go across, and their mean return is the exact one (4
    # standard errors, a chance of 6e-5 to fail by luck); the share in the hole is the slip's.
    true = ledge(0.1)
    found = explore(
        true,
        [true],
        Habits(None, exploring=0.0),
        robots=4_000,
        episodes=1,
        horizon=6,
        generator=np.random.default_rng(1),
    )
    across = np.zeros((5, 3))
    across[[0, 1, 2, 3, 4], [0, 1, 1, 1, 2]] = 1.0
    error = found.returns.std() / np.sqrt(found.returns.size)
    assert abs(found.returns.mean() - expected_return(true, across, 6)) < 4 * error
    assert abs(found.violated.mean() - 0.1) < 4 * np.sqrt(0.09 / 4_000)


def test_a_shield_sends_them_around_and_a_budget_lets_them_across() -> None:
    true, models = ledge(0.1), [ledge(0.1), ledge(0.2)]

    def rate(threshold: float) -> tuple[float, float]:
        found = explore(
            true,
            models,
            Habits(threshold, exploring=0.0),
            robots=500,
            episodes=2,
            horizon=6,
            generator=np.random.default_rng(1),
        )
        return float(found.violated.mean()), float(found.returns.mean())

    # Around: -1.5 - 1.5 + 10 = 7. At 0.15 the worst model, 0.2, still forbids the ledge.
    assert rate(0.0) == rate(0.15) == (0.0, 7.0)
    assert 0.05 < rate(0.2)[0] < 0.15


def test_equal_seeds_give_equal_episodes() -> None:
    one, other = (
        explore(
            ledge(0.1),
            [ledge(0.1), ledge(0.3)],
            Habits(0.3),
            robots=50,
            episodes=3,
            horizon=6,
            generator=np.random.default_rng(2),
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(one.returns, other.returns)
    assert one.episodes_to_goal.shape == (50,)
