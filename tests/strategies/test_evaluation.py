"""Curves and their criteria, by hand: optimum 6, worst -9 as on RQ1-1."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from merap.strategies.evaluation import Range, Row, Run, as_dict, judged, summary

PAPER = Range(optimum=6.0, worst=-9.0)
EPISODES = 35


def run_of(values: Sequence[float], reachable: Range = PAPER, seed: int = 0) -> Run:
    rows = [
        Row(step, step * EPISODES, value, None if step == 0 else value) for step, value in enumerate(values)
    ]
    return judged(seed, rows, reachable)


@pytest.mark.parametrize(
    ("optimum", "value", "within"),
    [
        # 6 - 0.05 * 6 = 5.7
        (6.0, 5.7001, True),
        (6.0, 5.6999, False),
        # -4 - 0.05 * 4 = -4.2; without the absolute value the limit would lie above the optimum
        (-4.0, -4.1999, True),
        (-4.0, -4.0, True),
        (-4.0, -4.2001, False),
        # of nothing, 5 percent are nothing
        (0.0, 0.0, True),
        (0.0, -1e-6, False),
        # better than the best, by rounding
        (6.0, 6.0000001, True),
    ],
)
def test_within_5_percent_of_the_optimum(optimum: float, value: float, within: bool) -> None:
    assert Range(optimum, optimum - 10).within_5_percent(value) is within


@pytest.mark.parametrize(("value", "good"), [(0.0, True), (-1e-12, True), (-1e-6, False)])
def test_an_optimum_of_0_is_reached_up_to_rounding(value: float, good: bool) -> None:
    """1e-9 of the 10 between the best and the worst."""
    assert Range(0.0, -10.0).within_5_percent(value) is good


def test_where_all_policies_are_worth_the_same_all_are_good() -> None:
    assert Range(-9.0, -9.0).solved(-9.000000000000002)


@pytest.mark.parametrize(
    ("optimum", "worst", "value", "solved"),
    [
        # 6 - 0.02 * 15 = 5.7
        (6.0, -9.0, 5.7001, True),
        (6.0, -9.0, 5.6999, False),
        # -4 - 0.02 * 50 = -5, though that is 25 percent off
        (-4.0, -54.0, -4.9999, True),
        (-4.0, -54.0, -5.0001, False),
    ],
)
def test_solved_is_relative_to_what_can_be_earned(
    optimum: float, worst: float, value: float, solved: bool
) -> None:
    assert Range(optimum, worst).solved(value) is solved


@pytest.mark.parametrize(
    ("values", "steps"),
    [
        ([6, 6, 6, 6], 0),
        ([-9, 6, 6, 6], 1),
        # twice is not enough, the first of the later three counts
        ([-9, 6, 6, 0, 6, 6, 6], 4),
        # what comes after three does not matter
        ([6, 6, 6, -9, -9], 0),
        # two at the end are not three
        ([-9, -9, -9, 6, 6], None),
        ([6, 6], None),
        ([-9, -9, -9, -9], None),
        ([6, 0, 6, 6, 0, 6], None),
        ([6, 5.8, 5.75, 0], 0),
    ],
)
def test_the_first_of_three_in_a_row_counts(values: Sequence[float], steps: int | None) -> None:
    run = run_of(values)
    assert run.steps_to_within_5_percent == steps
    episodes = None if steps is None else steps * EPISODES
    assert run.episodes_to_within_5_percent == episodes
    # 0.02 * 15 = 0.05 * 6: the two criteria agree for this optimum and worst value
    assert run.episodes_to_solved == episodes


def test_the_two_criteria_are_apart() -> None:
    # 5 percent of 1 are 0.05, 2 percent of the 20 that can be earned are 0.4.
    run = run_of([-9, 0.7, 0.7, 0.96, 0.96, 0.96], Range(1.0, -19.0))
    assert run.episodes_to_solved == 1 * EPISODES
    assert run.steps_to_within_5_percent == 3
    assert run.episodes_to_within_5_percent == 3 * EPISODES


def test_steps_and_episodes_are_those_of_the_row() -> None:
    """A curve need not count one step a row, nor the same number of episodes each."""
    rows = [Row(0, 0, -9, None), *(Row(10 + n, 100 + n * n, 6, 6) for n in range(3))]
    run = judged(3, rows, PAPER)
    assert (run.seed, run.steps_to_within_5_percent, run.episodes_to_within_5_percent) == (3, 10, 100)
    assert run.curve == tuple(rows)


def test_a_summary_counts_those_that_never_got_there_apart() -> None:
    fast, slow, never = run_of([-3, 6, 6, 6]), run_of([-9, 0, 0, 0, 0, 6, 6, 6]), run_of([-9, -9, -9, -2])
    found = summary([fast, slow, never])
    assert found["runs"] == 3
    # 1 and 5 steps
    assert found["mean_steps_to_within_5_percent"] == 3
    assert found["median_steps_to_within_5_percent"] == 3
    assert found["max_steps_to_within_5_percent"] == 5
    assert found["never_steps_to_within_5_percent"] == 1
    assert found["mean_episodes_to_within_5_percent"] == 3 * EPISODES
    assert found["max_episodes_to_solved"] == 5 * EPISODES
    assert found["never_episodes_to_solved"] == 1
    assert found["mean_initial_return"] == -7  # (-3 - 9 - 9) / 3
    assert found["mean_final_return"] == pytest.approx(10 / 3)  # (6 + 6 - 2) / 3
    assert found["min_final_return"] == -2


def test_a_summary_of_runs_that_all_never_got_there_has_no_mean() -> None:
    found = summary([run_of([-9, -9, -9])])
    assert found["mean_steps_to_within_5_percent"] is None
    assert found["max_episodes_to_solved"] is None
    assert found["never_episodes_to_within_5_percent"] == 1


def test_regret_is_what_the_policy_in_use_falls_short_of() -> None:
    # row 0 acts in the first 35 episodes, row 1 in the next: 35 * 15 + 35 * 9; row 2 has acted in none
    run = run_of([-9, -3, 5])
    assert run.first_episode_regret == 15
    assert run.cumulative_regret == 35 * 15 + 35 * 9
    # the episodes returned -3 and 5 on average: 35 * 9 + 35 * 1
    assert run.sampled_regret == 35 * 9 + 35 * 1


def test_regret_can_be_of_the_first_episodes_alone() -> None:
    # 40 episodes: 35 of the first step and 5 of the second
    run = judged(0, run_of([-9, -3, 5]).curve, PAPER, regret_episodes=40)
    assert run.cumulative_regret == 35 * 15 + 5 * 9
    assert run.sampled_regret == 35 * 9 + 5 * 1


def test_quantiles_count_those_that_never_got_there_as_longest() -> None:
    fast, never = run_of([6, 6, 6]), run_of([-9, -9, -9])
    slow = run_of([-9, 6, 6, 6])
    found = summary([fast] * 10 + [slow] * 9 + [never])
    assert found["quantile_50_episodes_to_within_5_percent"] == 0  # the 10th of 20
    assert found["quantile_95_episodes_to_within_5_percent"] == EPISODES  # the 19th of 20
    found = summary([fast] * 9 + [slow] * 9 + [never] * 2)
    assert found["quantile_50_episodes_to_within_5_percent"] == EPISODES
    assert found["quantile_95_episodes_to_within_5_percent"] is None


def test_regrets_are_summed_up() -> None:
    found = summary([run_of([-9, 6]), run_of([6, 6])])
    assert (found["mean_first_episode_regret"], found["max_first_episode_regret"]) == (7.5, 15)
    assert (found["mean_cumulative_regret"], found["max_cumulative_regret"]) == (35 * 7.5, 35 * 15)
    assert found["mean_sampled_regret"] == 0


def test_a_run_as_data() -> None:
    assert as_dict(run_of([-9, 6], seed=7)) == {
        "seed": 7,
        "curve": (
            {"step": 0, "episodes": 0, "expected_return": -9, "sampled_return": None},
            {"step": 1, "episodes": 35, "expected_return": 6, "sampled_return": 6},
        ),
        "steps_to_within_5_percent": None,
        "episodes_to_within_5_percent": None,
        "episodes_to_solved": None,
        "first_episode_regret": 15,
        "cumulative_regret": 35 * 15,
        "sampled_regret": 0,
        "steps_back": 0,
        "too_short": True,
    }


@pytest.mark.parametrize(
    ("values", "too_short"),
    [
        ([6], True),
        ([-9, -9], True),
        ([-9, 6, 6], True),
        ([6, 6, 6], False),
        ([-9, -9, -9], False),
        ([6, 6, -9], False),
        ([6, 6, 6, -9, 6], False),
    ],
)
def test_a_run_that_ended_too_soon_says_so(values: list[float], too_short: bool) -> None:
    """Three good rows in a row are needed: one or two at the end might have become three."""
    run = run_of(values)
    assert run.too_short is too_short
    assert summary([run, run])["too_short"] == 2 * too_short


@pytest.mark.parametrize(
    ("optimum", "worst", "nothing"),
    [
        (3.0, 3.0, True),
        (0.0, 0.0, True),
        (-40.0, -40.0 - 1e-12, True),
        (3.0, 2.9, False),
        (0.0, -1e-6, False),
    ],
)
def test_nothing_is_at_stake_where_all_policies_earn_the_same(
    optimum: float, worst: float, nothing: bool
) -> None:
    assert Range(optimum, worst).nothing_at_stake == nothing
