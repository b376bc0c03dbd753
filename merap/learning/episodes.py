"""Sampling episodes of many tasks at once.

Axes: N tasks, B episodes, T steps of the longest horizon, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from merap.learning.kernels import Array, Arrays, Numbers, compiled
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
    def arrays(self) -> Arrays:
        """State, action, reward and activity as the compiled code reads them."""
        parts = (self.state, self.action, self.reward, self.active)
        return tuple(part.contiguous().numpy() for part in parts)

    @property
    def returns(self) -> Tensor:
        """float [N, B], undiscounted."""
        return self.reward.sum(dim=-1)

    def mean_return(self, discount: float) -> Tensor:
        """float [N], mean discounted return."""
        times = torch.arange(self.reward.shape[-1], dtype=self.reward.dtype)
        return (self.reward @ discount**times).mean(dim=1)

    def visits(self, num_states: int) -> Tensor:
        """float [N, S], share of the active steps that begin in a state."""
        shares = torch.zeros(len(self.state), num_states, dtype=self.reward.dtype)
        shares.scatter_add_(1, self.state.flatten(1), self.active.flatten(1).to(shares.dtype))
        return shares / shares.sum(dim=1, keepdim=True).clamp_min(1)


def rollout(policy: Tensor, tasks: TaskBatch, num_episodes: int, generator: torch.Generator) -> Episodes:
    """Sample episodes of every task with a policy.

    Args:
        policy: float [N, S, A], a distribution over the enabled actions, 0 at the others.
        tasks: N tasks to act on.
        num_episodes: B.
        generator: source of randomness.
    """
    shape = (len(policy), num_episodes, tasks.longest_horizon + 1)
    return drawn_episodes(policy, tasks, torch.rand(shape, generator=generator, dtype=policy.dtype))


@torch.no_grad()
def drawn_episodes(policy: Tensor, tasks: TaskBatch, draws: Tensor) -> Episodes:
    """Return the episodes that draws lead to, by inversion.

    Args:
        policy: as in `rollout`.
        tasks: N tasks to act on.
        draws: float [N, B, T + 1] in [0, 1): one for the initial state, then one for action and successor
            of each step.
    """
    num_tasks, num_episodes, length = draws.shape
    starts = tasks.initial.cumsum(dim=1)
    starts /= starts[:, -1:].clone()
    state = torch.zeros(num_tasks, num_episodes, length - 1, dtype=torch.int64)
    state[:, :, 0] = torch.searchsorted(starts, draws[:, :, 0].contiguous(), right=True)
    action, active = torch.zeros_like(state), torch.zeros_like(state, dtype=torch.bool)
    reward = torch.zeros(state.shape, dtype=policy.dtype)
    first, _, target, _, _, _, horizon, _ = tasks.arrays
    branches = (first, target, tasks.branch_prob.numpy(), tasks.branch_reward.numpy())
    episodes = Episodes(state, action, reward, active)
    table = policy.detach().contiguous().numpy()
    _follow(table, branches, horizon, draws.contiguous().numpy(), episodes.arrays)
    return episodes


@compiled
def _follow(policy: Array, branches: Arrays, horizon: Numbers, draws: Array, episodes: Arrays) -> None:
    """Fill episodes [N, B, T] whose first state is given."""
    first, target, prob, earned = branches
    state, action, reward, active = episodes
    num_tasks, _, num_actions = policy.shape
    for n in range(num_tasks):
        for e in range(state.shape[1]):
            s = state[n, e, 0]
            for t in range(state.shape[2]):
                state[n, e, t] = s
                choice = s * num_actions
                if t < horizon[n] and first[n, choice] < first[n, choice + num_actions]:
                    a, left = _drawn(policy[n, s], 0, num_actions, draws[n, e, t + 1])
                    b, left = _drawn(prob, first[n, choice + a], first[n, choice + a + 1], left)
                    action[n, e, t], active[n, e, t], reward[n, e, t] = a, True, earned[b]
                    s = np.int64(target[b])


@compiled
def _drawn(shares: Array, first: int, last: int, draw: float) -> tuple[int, float]:
    """Return which outcome from first to last a draw in [0, 1) falls on, and where within it, in [0, 1).

    The last outcome of positive probability stands where rounding leaves a draw over.
    """
    drawn, left = first, float(draw)
    for other in range(first, last):
        if shares[other] > 0:
            drawn = other
            if left < shares[other]:
                return drawn, left / shares[other]
            left -= shares[other]
    return drawn, 0.0
