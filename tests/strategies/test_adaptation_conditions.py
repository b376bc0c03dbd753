"""Adaptation under slip, noise and without resets.

The system is `met` of RQ1-1: eight steps away, so the optimum is 10 - 0.5 * 8.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from merap.concerns.combination import ResetMode
from merap.runs.run_folder import RunFolder
from merap.strategies.adaptation import adapt
from merap.strategies.problem import Conditions
from merap.strategies.registry import BELIEF, STRATEGIES
from tests.support.whole_adaptations import values

OPTIMUM = 6.0


def test_slip_is_in_what_policies_are_scored_by_and_in_what_is_met(hasty: RunFolder) -> None:
    """Eight moves that work with 0.8 each, then `stop`: the optimum is that of waiting for eight successes.

    By time t the goal is reached with the eighth success at move t: negative binomial. A slip in the goal
    ends the task with the reward of `stop` all the same. Not reached: 18 steps at -0.5.
    """
    work = 0.8
    arrival = {t: math.comb(t - 1, 7) * work**8 * (1 - work) ** (t - 8) for t in range(8, 18)}
    late = 1 - sum(arrival.values())
    mean = sum(p * (10 - 0.5 * t) for t, p in arrival.items()) - 9 * late
    found = adapt(
        hasty,
        hasty.case.system("met"),
        strategy="oracle",
        steps=400,
        conditions=Conditions(slip=1 - work),
    )
    assert found.reachable.optimum == pytest.approx(mean)
    assert values(found)[0] == pytest.approx(mean)
    earned = [row.sampled_return for row in found.runs[0].curve if row.sampled_return is not None]
    square = sum(p * (10 - 0.5 * t) ** 2 for t, p in arrival.items()) + 81 * late
    # within 4 standard errors: another seed fails with a chance of 6e-5
    assert abs(np.mean(earned) - mean) <= 4 * math.sqrt((square - mean**2) / len(earned))


def test_noise_is_on_the_rewards_that_are_seen_alone(hasty: RunFolder) -> None:
    met = hasty.case.system("met")
    noisy = Conditions(reward_noise=2.0)
    found = adapt(hasty, met, strategy="oracle", steps=400, conditions=noisy)
    assert values(found) == pytest.approx([OPTIMUM] * len(values(found)))
    # nine steps, each with a variance of 4
    earned = np.array([row.sampled_return for row in found.runs[0].curve[1:]])
    assert abs(earned.mean() - OPTIMUM) <= 4 * math.sqrt(36 / 400)  # fails by luck with 6e-5
    # the variance of a sample variance of n normal numbers is 2 sigma^4 / (n - 1)
    assert abs(earned.var(ddof=1) - 36) <= 4 * 36 * math.sqrt(2 / 399)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", [name for name in STRATEGIES if name != "pretrained"])
@pytest.mark.parametrize("reset", ["return_to_start", "none"])
def test_every_strategy_can_do_without_resets(hasty: RunFolder, strategy: str, reset: ResetMode) -> None:
    found = adapt(
        hasty,
        hasty.case.system("met"),
        strategy=strategy,
        episodes_per_step=2,
        max_episodes=6,
        conditions=Conditions(reset=reset),
    )
    assert found.runs[0].curve[-1].episodes == 6
    assert found.as_dict()["reset"] == reset
    assert (found.runs[0].steps_back > 0) == (reset == "return_to_start")


def test_the_way_back_is_counted(hasty: RunFolder) -> None:
    """The oracle ends in the goal, eight steps from the start; before the last episode it is there again."""
    conditions = Conditions(reset="return_to_start")
    found = adapt(hasty, hasty.case.system("met"), strategy="oracle", steps=5, conditions=conditions)
    assert found.runs[0].steps_back == 4 * 8


def test_without_resets_the_next_episode_begins_where_the_last_ended(hasty: RunFolder) -> None:
    """In the goal: from the second episode on `stop` is all there is to do."""
    conditions = Conditions(reset="none")
    found = adapt(hasty, hasty.case.system("met"), strategy="oracle", steps=4, conditions=conditions)
    assert [row.sampled_return for row in found.runs[0].curve] == [None, OPTIMUM, 10, 10, 10]
    # scores are from the declared start all the same
    assert values(found) == pytest.approx([OPTIMUM] * len(values(found)))


@pytest.mark.slow
def test_a_belief_finds_the_goal_without_resets(hasty: RunFolder) -> None:
    conditions = Conditions(reset="none")
    found = adapt(
        hasty, hasty.case.system("met"), strategy=BELIEF, steps=10, seeds=(0, 1, 2), conditions=conditions
    )
    assert all(run.episodes_to_within_5_percent is not None for run in found.runs)
