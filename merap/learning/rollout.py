"""Sampling episodes of many tasks at once by gathers on their arrays.

Axes: N tasks, B episodes, T steps, S states, A actions, K successors.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from merap.learning.tasks import TaskBatch


@dataclass(frozen=True, eq=False)
class Episodes:
    """Episodes of N tasks; steps after an end are inactive and have reward 0.

    Attributes:
        state: int64 [N, B, T], where the step began.
        action: int64 [N, B, T]; means nothing where inactive.
        reward: float [N, B, T].
        active: bool [N, B, T], the step was taken.
    """

    state: Tensor
    action: Tensor
    reward: Tensor
    active: Tensor

    def __post_init__(self) -> None:
        shape = self.state.shape
        assert len(shape) == 3, shape
        for array in (self.action, self.reward, self.active):
            assert array.shape == shape, (array.shape, shape)

    @property
    def returns(self) -> Tensor:
        """float [N, B], undiscounted."""
        return self.reward.sum(dim=-1)


@dataclass(frozen=True, eq=False)
class Sampler:
    """A task batch laid out for sampling: the states of all tasks in one row of N * S.

    Attributes:
        next_state: int64 [N * S * M], an index into N * S, with M = A K branches per state.
        reward: float [N * S * M].
        prob: float [N, S, A, K].
        live: bool [N * S], some action is enabled.
        initial: float [N, S], cumulated over S.
        num_successors: K.
        horizon: T.
    """

    next_state: Tensor
    reward: Tensor
    prob: Tensor
    live: Tensor
    initial: Tensor
    num_successors: int
    horizon: int


def sampler(tasks: TaskBatch) -> Sampler:
    """Lay out a task batch."""
    first_state = torch.arange(tasks.num_tasks) * tasks.num_states
    return Sampler(
        next_state=(tasks.next_state + first_state[:, None, None, None]).flatten(),
        reward=tasks.reward.flatten(),
        prob=tasks.prob,
        live=tasks.enabled.any(dim=-1).flatten(),
        initial=_cumulated(tasks.initial),
        num_successors=tasks.num_successors,
        horizon=tasks.horizon,
    )


def rollout(policy: Tensor, tasks: Sampler, num_episodes: int, generator: torch.Generator) -> Episodes:
    """Sample episodes of every task with a policy.

    Action and successor are one draw, from the product of both distributions.

    Args:
        policy: float [N, S, A], a distribution over the enabled actions, 0 at the others.
        tasks: what to act on.
        num_episodes: B.
        generator: source of randomness.
    """
    # The last branch needs no bound; a row without an enabled action takes it and stays in the state.
    bounds = _cumulated((policy.detach().unsqueeze(-1) * tasks.prob).flatten(2))[..., :-1].flatten(0, 1)
    num_branches = bounds.shape[1] + 1
    draws = torch.rand(tasks.horizon + 1, len(policy), num_episodes, generator=generator, dtype=policy.dtype)
    state = _initial_states(tasks, draws[0])
    visited, taken = [], []
    for t in range(tasks.horizon):
        rank = torch.searchsorted(bounds.index_select(0, state), draws[t + 1].view(-1, 1), right=True)
        branch = state * num_branches + rank.view(-1)
        visited.append(state)
        taken.append(branch)
        state = tasks.next_state.index_select(0, branch)
    return _episodes(tasks, torch.stack(visited, -1), torch.stack(taken, -1), policy.shape)


def _cumulated(prob: Tensor) -> Tensor:
    """Cumulated over the last axis up to exactly 1, so that no draw falls behind the last outcome."""
    total = prob.cumsum(dim=-1)
    return total / total[..., -1:].clamp_min(torch.finfo(prob.dtype).tiny)


def _initial_states(tasks: Sampler, draws: Tensor) -> Tensor:
    """int64 [N * B], indices into N * S, of draws [N, B]."""
    num_tasks, num_states = tasks.initial.shape
    state = torch.searchsorted(tasks.initial, draws, right=True)
    return (state + torch.arange(num_tasks).unsqueeze(1) * num_states).flatten()


def _episodes(tasks: Sampler, visited: Tensor, taken: Tensor, shape: torch.Size) -> Episodes:
    """Episodes of states and branches [N * B, T]."""
    num_tasks, num_states, num_actions = shape
    active = tasks.live.take(visited)
    within = taken - visited * (num_actions * tasks.num_successors)
    parts = {
        "state": visited % num_states,
        "action": within // tasks.num_successors,
        "reward": tasks.reward.take(taken) * active,
        "active": active,
    }
    return Episodes(**{name: part.view(num_tasks, -1, tasks.horizon) for name, part in parts.items()})
