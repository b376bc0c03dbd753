"""Sampled episodes: frequencies, masks, ends, and the mean of a million returns."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import chi2
from torch import Tensor

from merap.learning.episodes import Episodes, drawn_episodes, rollout
from merap.learning.exact import expected_return
from merap.learning.tasks import TaskBatch
from merap.learning.threads import one_thread
from tests.support.learning_examples import dense, grid_batch, random_table, ring_batch, seeded, with_horizon

# A normal variable leaves 4 standard deviations with a probability of 6.3e-5.
LUCK = math.erfc(4 / math.sqrt(2))


def _sampled(tasks: TaskBatch, policy: Tensor, num_episodes: int, seed: int = 0) -> Episodes:
    with one_thread():
        return rollout(policy, tasks, num_episodes, seeded(seed))


def _steps(episodes: Episodes) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Task, state, action and successor of all active steps but those at the horizon."""
    task = torch.arange(len(episodes.state)).view(-1, 1, 1).expand_as(episodes.state)[..., 1:]
    taken = episodes.active[..., :-1]
    parts = (task, episodes.state[..., :-1], episodes.action[..., :-1], episodes.state[..., 1:])
    task, state, action, successor = (part[taken] for part in parts)
    return task, state, action, successor


@pytest.mark.parametrize(
    "made",
    [
        pytest.param(lambda: grid_batch(dtype=torch.float32), id="deterministic"),
        pytest.param(lambda: grid_batch(0.2, torch.float32), id="slipping"),
        pytest.param(lambda: ring_batch(torch.float32), id="ring"),
    ],
)
def test_a_million_returns_average_the_exact_one(made: Callable[[], TaskBatch]) -> None:
    """Within 4 standard errors: each of the two comparisons fails by luck with 6.3e-5."""
    tasks = made()[:1]
    policy = random_table(tasks.enabled, 7)
    to_discount = tasks.discount ** torch.arange(tasks.longest_horizon, dtype=torch.float64)
    generator, found = seeded(11), []
    with one_thread():
        for _ in range(100):
            reward = rollout(policy.float(), tasks, 10_000, generator).reward.double()
            found.append(torch.stack([reward.sum(dim=-1), reward @ to_discount]))
    returns = torch.cat(found, dim=-1).squeeze(1)
    assert returns.shape == (2, 1_000_000)
    error = returns.std(dim=-1) / math.sqrt(1_000_000)
    for sampled, allowed, discount in zip(
        returns.mean(dim=-1), 4 * error, (1.0, tasks.discount), strict=True
    ):
        exact = expected_return(policy.float(), replace(tasks, discount=discount))
        assert abs(sampled - exact.item()) < allowed


def test_actions_and_successors_have_their_probabilities() -> None:
    """Chi-square of each (task, state) over action and successor; all at once fail by luck with 6.3e-5."""
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 3)
    task, state, action, successor = _steps(_sampled(tasks, policy, 40_000))
    shape = (tasks.num_tasks, tasks.num_states, tasks.num_actions * tasks.num_states)
    cell = ((task * shape[1] + state) * tasks.num_actions + action) * shape[1] + successor
    counts = torch.bincount(cell, minlength=math.prod(shape)).view(shape).double().numpy()
    expected = policy.unsqueeze(-1) * dense(tasks, tasks.branch_prob)
    expected_counts = expected.view(shape).numpy() * counts.sum(axis=2, keepdims=True)
    assert np.all(counts[expected_counts == 0] == 0)
    filled = expected_counts >= 5  # below it the approximation is poor
    statistic = ((counts - expected_counts)[filled] ** 2 / expected_counts[filled]).sum()
    freedom = filled.sum() - filled.any(axis=2).sum()
    assert freedom > 60
    assert chi2.sf(statistic, freedom) > LUCK


def test_initial_states_have_their_probabilities() -> None:
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 3)
    first = _sampled(tasks, policy, 40_000).state[..., 0]
    counts = torch.nn.functional.one_hot(first, tasks.num_states).double().mean(dim=1)
    deviation = (tasks.initial * (1 - tasks.initial) / 40_000).sqrt()
    assert torch.all((counts - tasks.initial).abs() <= 4 * deviation)  # 0 where it must be 0
    assert torch.all(deviation.count_nonzero(dim=1) == 2)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_no_disabled_action_and_no_impossible_branch_is_taken(dtype: torch.dtype) -> None:
    for tasks in (ring_batch(dtype), grid_batch(0.2, dtype)):
        policy = random_table(tasks.enabled, 5)
        # an action that is enabled but never wanted
        policy[..., 1] *= (policy[..., 1] < policy.sum(dim=-1)) & (torch.arange(tasks.num_states) % 2 == 0)
        policy = (policy / policy.sum(dim=-1, keepdim=True).clamp_min(1e-300)).to(dtype)
        task, state, action, successor = _steps(_sampled(tasks, policy, 3_000))
        assert len(state) > 10_000
        assert torch.all(policy[task, state, action] > 0)
        assert torch.all(dense(tasks, tasks.branch_prob)[task, state, action, successor] > 0)


def test_episodes_stop_in_the_completed_state() -> None:
    tasks = grid_batch(0.2)
    episodes = _sampled(tasks, random_table(tasks.enabled, 5), 3_000)
    completed = tasks.num_states - 1
    assert torch.equal(episodes.active, episodes.state != completed)
    assert torch.all(episodes.active[..., 0])
    ended = ~episodes.active
    assert 0 < ended[..., -1].double().mean() < 1
    assert torch.all(ended[..., 1:] >= ended[..., :-1])
    assert torch.all(episodes.reward[ended] == 0)
    assert torch.all(episodes.reward[episodes.active] != 0)
    assert torch.equal(episodes.returns, episodes.reward.sum(dim=2))


def test_rewards_are_those_of_the_branches_taken() -> None:
    tasks = ring_batch()
    episodes = _sampled(tasks, random_table(tasks.enabled, 5), 3_000)
    task, state, action, successor = _steps(episodes)
    reward = episodes.reward[..., :-1][episodes.active[..., :-1]]
    # the branches of one action lead to different states
    assert dense(tasks, torch.ones_like(tasks.branch_prob)).max() == 1
    assert torch.equal(reward, dense(tasks, tasks.branch_reward)[task, state, action, successor])


def test_a_certain_way_through_the_grid() -> None:
    tasks = grid_batch()[:1]
    wanted = torch.full((tasks.num_states,), 2)  # down
    wanted[9], wanted[10] = 4, 0  # right, and stop in the goal (1, 1)
    policy = torch.nn.functional.one_hot(wanted, 5) * tasks.enabled
    episodes = _sampled(tasks, policy.double(), 2)
    for b in range(2):
        assert episodes.state[0, b, :4].tolist() == [0, 9, 10, 81]
        assert episodes.action[0, b, :3].tolist() == [2, 4, 0]
        assert episodes.reward[0, b].tolist() == [-0.5, -0.5, 10.0] + [0.0] * 15
        assert episodes.active[0, b].tolist() == [True] * 3 + [False] * 15


def test_episodes_depend_on_the_generator_alone() -> None:
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 5)
    first, again, other = (_sampled(tasks, policy, 50, seed) for seed in (1, 1, 2))
    for name in ("state", "action", "reward", "active"):
        assert torch.equal(getattr(first, name), getattr(again, name))
    assert not torch.equal(first.state, other.state)
    generator = seeded(1)
    drawn = [rollout(policy, tasks, 50, generator).state for _ in range(2)]
    assert torch.equal(drawn[0], first.state)
    assert not torch.equal(drawn[0], drawn[1])


def test_tasks_and_episodes_are_independent() -> None:
    """Twice the same task: the returns of episode b differ between the two, and are not correlated."""
    tasks = ring_batch()[[0, 0]]
    policy = random_table(tasks.enabled[:1], 5).repeat(2, 1, 1)
    returns = _sampled(tasks, policy, 20_000).returns
    correlation = torch.corrcoef(returns)[0, 1]
    assert abs(correlation) < 4 / math.sqrt(20_000)
    neighbours = torch.corrcoef(torch.stack([returns[0, :-1], returns[0, 1:]]))[0, 1]
    assert abs(neighbours) < 4 / math.sqrt(20_000)


def test_sampling_leaves_no_graph() -> None:
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 5).requires_grad_()
    episodes = _sampled(tasks, policy, 3)
    assert not episodes.reward.requires_grad


def test_the_horizon_cuts_episodes() -> None:
    tasks = with_horizon(ring_batch(), 1)
    policy = random_table(tasks.enabled, 5)
    episodes = _sampled(tasks, policy, 7)
    assert episodes.state.shape == (3, 7, 1)
    assert episodes.active.all()


def test_a_draw_of_exactly_zero_takes_no_impossible_branch() -> None:
    """0 is the lower bound of the branches of probability 0 in front."""
    tasks = with_horizon(ring_batch(), 1)
    policy = torch.zeros(tasks.enabled.shape, dtype=torch.float64)
    policy[..., 5] = tasks.enabled[..., 5]  # `start_scan` is the last action
    episodes = drawn_episodes(policy, tasks, torch.zeros(3, 4, 2, dtype=torch.float64))
    assert torch.all(episodes.action == 5)


def test_a_draw_just_below_one_takes_the_last_possible_branch() -> None:
    tasks = with_horizon(ring_batch(torch.float32), 1)
    policy = torch.zeros(tasks.enabled.shape)
    policy[..., 0] = tasks.enabled[..., 0]
    draws = torch.full((3, 4, 2), float(np.nextafter(np.float32(1), np.float32(0))))
    episodes = drawn_episodes(policy, tasks, draws)
    assert torch.all(episodes.action[episodes.active] == 0)


def test_tasks_may_have_horizons_of_their_own() -> None:
    """Each task's episodes are those of a batch with its horizon, cut there."""
    tasks = with_horizon(ring_batch(), [3, 12, 1])
    policy = random_table(tasks.enabled, 5)
    draws = torch.rand(3, 20, 13, generator=seeded(2), dtype=torch.float64)
    episodes = drawn_episodes(policy, tasks, draws)
    whole = drawn_episodes(policy, ring_batch(), draws)
    assert episodes.state.shape == (3, 20, 12)
    for n, horizon in enumerate((3, 12, 1)):
        assert torch.equal(episodes.state[n, :, :horizon], whole.state[n, :, :horizon])
        assert torch.equal(episodes.active[n, :, :horizon], whole.active[n, :, :horizon])
        assert not episodes.active[n, :, horizon:].any()
        assert torch.all(episodes.reward[n, :, horizon:] == 0)
