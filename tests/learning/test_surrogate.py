"""Baselines and advantages: closed forms and dense regressions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from merap.learning import surrogate as module
from merap.learning.config import Baseline
from merap.learning.episodes import Episodes, rollout
from merap.learning.surrogate import AdvantageRule, baseline_values, discounted_sums
from tests.support.learning_examples import grid_batch, random_table, ring_batch, seeded


def advantages(
    episodes: Episodes, num_states: int, baseline: Baseline, discount: float, lam: float
) -> Tensor:
    return module.advantages(episodes, num_states, AdvantageRule(discount, lam, baseline, 1.0, 0.0, 0.0))


def _episodes(num_episodes: int = 9) -> tuple[Episodes, int]:
    """Episodes of three tasks, and the number of states; many end before the horizon."""
    tasks = ring_batch()
    episodes = rollout(random_table(tasks.enabled, 2), tasks, num_episodes, seeded(4))
    return episodes, tasks.num_states


def _ridge_regression(episodes: Episodes, to_go: Tensor, task: int, num_states: int, ridge: float) -> Tensor:
    """[B, T]: least squares with `ridge` as additional rows, every feature written out."""
    _, num_episodes, horizon = to_go.shape
    time = torch.arange(horizon).double().expand(num_episodes, horizon) / 100
    one_hot = torch.nn.functional.one_hot(episodes.state[task], num_states).double()
    features = torch.cat(
        [one_hot, torch.stack([time, time**2, time**3, torch.ones_like(time)], dim=-1)], dim=-1
    )
    active = episodes.active[task]
    damping = ridge**0.5 * torch.eye(num_states + 4, dtype=torch.float64)
    rows = torch.cat([features[active], damping])
    target = torch.cat([to_go[task][active], torch.zeros(num_states + 4, dtype=torch.float64)])
    coefficients: Tensor = torch.linalg.lstsq(rows, target.unsqueeze(-1)).solution
    return (features @ coefficients).squeeze(-1)


@pytest.mark.parametrize("ridge", [1e-2, 1.0, 30.0])
@pytest.mark.parametrize("num_episodes", [1, 9])
def test_the_linear_baseline_is_a_ridge_regression(ridge: float, num_episodes: int) -> None:
    episodes, num_states = _episodes(num_episodes)
    assert not episodes.active.all()
    to_go = discounted_sums(episodes.reward, 0.9)
    found = baseline_values(episodes, to_go, num_states, "linear", ridge)
    for task in range(3):
        active = episodes.active[task]
        expected = _ridge_regression(episodes, to_go, task, num_states, ridge)
        torch.testing.assert_close(found[task][active], expected[active], rtol=1e-8, atol=1e-8)


def test_the_linear_baseline_of_the_grid_in_single_precision() -> None:
    tasks = grid_batch(dtype=torch.float32)
    policy = random_table(tasks.enabled, 2).float()
    episodes = rollout(policy, tasks, 35, seeded(4))
    to_go = discounted_sums(episodes.reward, 0.95)
    found = baseline_values(episodes, to_go, tasks.num_states, "linear", 1.0)
    assert found.dtype == torch.float32
    for task in range(2):
        active = episodes.active[task]
        expected = _ridge_regression(episodes, to_go.double(), task, tasks.num_states, 1.0)
        torch.testing.assert_close(found[task][active].double(), expected[active], rtol=1e-5, atol=1e-5)


def test_the_time_baseline_is_the_mean_of_what_is_active() -> None:
    episodes, num_states = _episodes()
    to_go = discounted_sums(episodes.reward, 0.9)
    found = baseline_values(episodes, to_go, num_states, "time", 1.0)
    assert torch.all(found[~episodes.active] == 0)
    for task, values in enumerate(found):
        for t in range(values.shape[1]):
            active = episodes.active[task, :, t]
            if active.any():
                mean = to_go[task, active, t].mean().item()
                assert values[active, t].tolist() == pytest.approx([mean] * int(active.sum()))


def test_no_baseline_is_zero_and_the_linear_one_only_where_active() -> None:
    episodes, num_states = _episodes()
    to_go = discounted_sums(episodes.reward, 0.9)
    assert torch.all(baseline_values(episodes, to_go, num_states, "none", 1.0) == 0)
    linear = baseline_values(episodes, to_go, num_states, "linear", 1.0)
    assert torch.all(linear[~episodes.active] == 0)
    assert torch.all(linear[episodes.active] != 0)


@pytest.mark.parametrize("discount", [0.9, 1.0])
def test_lambda_one_is_the_return_to_go_minus_the_baseline(discount: float) -> None:
    # Schulman et al. 2016, eq. 18
    episodes, num_states = _episodes()
    to_go = discounted_sums(episodes.reward, discount)
    values = baseline_values(episodes, to_go, num_states, "linear", 1.0)
    expected = (to_go - values) * episodes.active
    torch.testing.assert_close(advantages(episodes, num_states, "linear", discount, 1.0), expected)


def test_lambda_zero_is_the_temporal_difference() -> None:
    # Schulman et al. 2016, eq. 17
    episodes, num_states = _episodes()
    values = baseline_values(episodes, discounted_sums(episodes.reward, 0.9), num_states, "time", 1.0)
    ahead = torch.cat([values[..., 1:], torch.zeros_like(values[..., :1])], dim=-1)
    expected = (episodes.reward + 0.9 * ahead - values) * episodes.active
    torch.testing.assert_close(advantages(episodes, num_states, "time", 0.9, 0.0), expected)


def test_advantages_by_hand() -> None:
    """Two episodes, the baseline is their mean at each step; discount 1/2 and lambda 1/2.

    Rewards (1, 4) and (3, 0): returns-to-go (3, 4) and (3, 0), baseline (3, 2). Of the first,
    delta_1 = 4 - 2 = 2 and delta_0 = 1 + 2/2 - 3 = -1: advantages -1 + 2/4 and 2. Of the second,
    delta_1 = -2 and delta_0 = 3 + 2/2 - 3 = 1: advantages 1 - 2/4 and -2.
    """
    whole = torch.zeros(1, 2, 3, dtype=torch.int64)
    active = torch.tensor([[[True, True, False], [True, True, False]]])
    reward = torch.tensor([[[1.0, 4.0, 0.0], [3.0, 0.0, 0.0]]])
    found = advantages(Episodes(whole, whole, reward, active), 1, "time", 0.5, 0.5)
    assert found.tolist() == [[[-0.5, 2.0, 0.0], [0.5, -2.0, 0.0]]]


def test_sums_of_a_constant_are_geometric() -> None:
    gamma, horizon = 0.95, 18
    expected = [(1 - gamma ** (horizon - t)) / (1 - gamma) for t in range(horizon)]
    found = discounted_sums(torch.ones(2, 3, horizon, dtype=torch.float64), gamma)
    np.testing.assert_allclose(found.numpy(), np.broadcast_to(expected, (2, 3, horizon)), rtol=1e-13)


@pytest.mark.parametrize("discount", [0.0, 0.5, 1.0])
def test_sums_follow_the_backward_recursion(discount: float) -> None:
    terms = torch.randn(4, 2, 6, generator=seeded(0), dtype=torch.float64)
    expected: list[Tensor] = []
    ahead = torch.zeros(4, 2, dtype=torch.float64)
    for term in reversed(terms.unbind(dim=-1)):
        ahead = term + discount * ahead
        expected.insert(0, ahead)
    torch.testing.assert_close(discounted_sums(terms, discount), torch.stack(expected, -1))


def test_sums_by_hand() -> None:
    # 1 + 2/2 + 4/4, 2 + 4/2, 4
    assert discounted_sums(torch.tensor([[[1.0, 2.0, 4.0]]]), 0.5).tolist() == [[[3, 4, 4]]]
    assert discounted_sums(torch.tensor([[[1.0, 2.0, 4.0]]]), 0.0).tolist() == [[[1, 2, 4]]]
    assert discounted_sums(torch.tensor([[[1.0, 2.0, 4.0]]]), 1.0).tolist() == [[[7, 6, 4]]]
