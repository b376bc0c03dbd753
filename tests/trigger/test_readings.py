"""What a model says of steps, on the paper's world made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from merap.mdp.evaluation import as_policy
from merap.mdp.model import Floats
from merap.mdp.planning import backward_induction
from merap.trigger.readings import NEAR, Forecast, ObservedSteps, Readings
from merap.trigger.settings import ChangeSettings
from tests.support.grid_tasks import COMPLETED, HORIZON, grid_model, grid_task

STOP, UP, DOWN, LEFT, RIGHT, END = range(6)
SLIP = 0.1
FLOOR = 0.01
MODEL = grid_model(grid_task((0, 2)), SLIP)
POLICY = as_policy(MODEL, backward_induction(MODEL, HORIZON).actions)
FORECAST = Forecast(
    MODEL, POLICY, HORIZON, ChangeSettings(floor=FLOOR, odds=(1.0, 5.0), share=0.2, noise=0.5)
)
NUM_STATES = COMPLETED + 1


def read(time: int, state: int, action: int, targets: list[int], reward: float = -0.5) -> Readings:
    count = len(targets)
    return FORECAST.read(
        ObservedSteps(
            time=np.full(count, time),
            state=np.full(count, state),
            action=np.full(count, action),
            target=np.array(targets),
            reward=np.full(count, reward),
            last=np.zeros(count, dtype=np.bool_),
        )
    )


def anything(near: bool, neighbours: int) -> float:
    return NEAR * near / neighbours + (1 - NEAR) / NUM_STATES


def test_the_likelihood_is_that_of_the_model_with_its_floor() -> None:
    """To the right from (0, 0): (0, 1) with 0.9, stay with 0.1; (1, 0) is next to it, (5, 5) is not."""
    found = read(0, 0, RIGHT, [1, 0, 9, 50])
    # up, left and stop stay in the corner: three states are near
    expected = [
        0.99 * 0.9 + 0.01 * anything(True, 3),
        0.99 * 0.1 + 0.01 * anything(True, 3),
        0.01 * anything(True, 3),
        0.01 * anything(False, 3),
    ]
    np.testing.assert_allclose(np.exp(found.log_likelihood), expected)


def test_a_watched_change_multiplies_the_odds_of_a_surprise() -> None:
    """The odds of a slip are 1 : 9; five times that is 5 : 9. A fifth of the steps does anything."""
    found = np.exp(read(0, 0, RIGHT, [1, 0]).log_alternatives)
    other = 0.2 * anything(True, 3)
    np.testing.assert_allclose(found[:, 0], [0.8 * 0.9 + other, 0.8 * 0.1 + other])
    np.testing.assert_allclose(found[:, 1], [0.8 * 9 / 14 + other, 0.8 * 5 / 14 + other])


def test_at_one_place_the_odds_are_30_times_as_large_or_half_of_the_steps_do_anything() -> None:
    """The odds of a slip are 1 : 9; thirty times that is 30 : 9. A state and its action are one place."""
    reading = read(0, 0, RIGHT, [1, 0, 0])
    found, other = np.exp(reading.log_local), anything(True, 3)
    np.testing.assert_allclose(found[:2, 0], np.array([9, 30]) / 39 * 0.98 + 0.02 * other)
    np.testing.assert_allclose(found[:2, 1], 0.5 * np.array([0.9, 0.1]) + 0.5 * other)
    elsewhere = [read(0, state, action, [1]).place[0] for state, action in ((0, UP), (1, RIGHT))]
    assert len({*reading.place.tolist(), *elsewhere}) == 3


@pytest.mark.parametrize(("state", "action"), [(0, RIGHT), (0, UP), (40, LEFT), (2, STOP), (COMPLETED, END)])
def test_all_likelihoods_are_distributions(state: int, action: int) -> None:
    found = read(3, state, action, list(range(NUM_STATES)))
    assert np.exp(found.log_likelihood).sum() == pytest.approx(1)
    np.testing.assert_allclose(np.exp(found.log_alternatives).sum(axis=0), [1, 1])
    np.testing.assert_allclose(np.exp(found.log_local).sum(axis=0), [1, 1])


@pytest.mark.parametrize(("state", "action"), [(0, RIGHT), (0, UP), (40, LEFT), (2, STOP)])
@pytest.mark.parametrize("without_floor", [True, False])
def test_the_mean_of_the_likelihood_ratio_is_at_most_1(state: int, action: int, without_floor: bool) -> None:
    """Under the model with its floor it is 1; under the model alone it is less (`evidence`)."""
    found = read(0, state, action, list(range(NUM_STATES)))
    prob = successors(state, action) if without_floor else np.exp(found.log_likelihood)
    changed = np.concatenate([found.log_alternatives, found.log_local], axis=1)
    ratio = np.exp(changed - found.log_likelihood[:, np.newaxis])
    mean = prob @ ratio
    if without_floor:
        assert np.all(mean < 1)
    else:
        np.testing.assert_allclose(mean, 1)


def successors(state: int, action: int) -> Floats:
    (choice,) = np.flatnonzero((MODEL.choice_state == state) & (MODEL.choice_action == action))
    row: Floats = MODEL.transitions[[choice]].toarray()[0]
    return row


@pytest.mark.parametrize("time", [0, 7, HORIZON - 1])
@pytest.mark.parametrize(("state", "action"), [(0, RIGHT), (0, UP), (40, LEFT), (2, STOP), (1, RIGHT)])
def test_gains_have_mean_0_and_the_stated_variance(time: int, state: int, action: int) -> None:
    found = read(time, state, action, list(range(NUM_STATES)))
    prob = successors(state, action)
    assert prob @ found.gain == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(found.gain_variance, prob @ found.gain**2, atol=1e-12)


def test_gains_and_residuals_of_an_episode_sum_to_its_return_less_what_was_expected() -> None:
    """Two steps right, one slip between them, then stop: 10 - 0.5 * 3, whatever the model thinks of it."""
    states, actions = [0, 1, 1, 2], [RIGHT, RIGHT, RIGHT, STOP]
    rewards = np.array([-0.5, -0.7, -0.5, 10.0])
    found = FORECAST.read(
        ObservedSteps(
            time=np.arange(4),
            state=np.array(states),
            action=np.array(actions),
            target=np.array([*states[1:], COMPLETED]),
            reward=rewards,
            last=np.array([False, False, False, True]),
        )
    )
    assert all(
        POLICY[t, state, action] == 1 for t, (state, action) in enumerate(zip(states, actions, strict=True))
    )
    total = found.gain.sum() + (found.reward - found.expected_reward).sum()
    assert total == pytest.approx(rewards.sum() - FORECAST.policy_value)


def test_the_sum_telescopes_through_what_the_model_holds_impossible() -> None:
    """A jump, then steps to the end of the horizon far from the goal: the episode's return is -9."""
    states = [0, 60, *([60] * 16)]
    actions = [int(POLICY[t, state].argmax()) for t, state in enumerate(states)]
    found = FORECAST.read(
        ObservedSteps(
            time=np.arange(HORIZON),
            state=np.array(states),
            action=np.array(actions),
            target=np.array([*states[1:], 60]),
            reward=np.full(HORIZON, -0.5),
            last=np.arange(HORIZON) == HORIZON - 1,
        )
    )
    total = found.gain.sum() + (found.reward - found.expected_reward).sum()
    assert total == pytest.approx(-9 - FORECAST.policy_value)


def test_a_state_that_the_model_does_not_reach_says_nothing_of_transitions() -> None:
    model = grid_model(grid_task((4, 4), [(0, 1)]), SLIP)
    policy = as_policy(model, backward_induction(model, HORIZON).actions)
    forecast = Forecast(model, policy, HORIZON, ChangeSettings())
    time, state, action, target = (np.array([value]) for value in (0, 1, RIGHT, 2))
    steps = ObservedSteps(time, state, action, target, np.array([-0.5]), np.array([False]))
    one = forecast.read(steps)[0]
    assert (*one.log_alternatives, *one.log_local) == pytest.approx((one.log_likelihood,) * 4)
    assert (one.expected_reward, one.gain_variance) == (0.0, 0.0)


def test_one_reading_is_a_row_of_all() -> None:
    many = read(2, 0, RIGHT, [1, 0, 9])
    for index, target in enumerate([1, 0, 9]):
        assert many[index] == FORECAST.read_step(2, 0, RIGHT, target, -0.5)
    assert len(many) == 3


def test_rewards_are_expected_for_the_successor_that_is_seen() -> None:
    """In the goal any action ends the task; `stop` there earns 10, elsewhere a step costs 0.5."""
    assert read(0, 2, STOP, [COMPLETED]).expected_reward[0] == 10.0
    assert read(0, 1, RIGHT, [2]).expected_reward[0] == -0.5
    assert math.isclose(FORECAST.policy_value, MODEL.initial @ backward_induction(MODEL, HORIZON).values[0])
