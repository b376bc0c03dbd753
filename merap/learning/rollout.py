"""Sampling episodes of many tasks at once on their arrays.

Axes: N tasks, B episodes, T steps, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from merap.learning.core import episodes as core
from merap.learning.core.task import Tasks
from merap.learning.layout import array_of, core_tasks
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

    @property
    def arrays(self) -> core.Episodes:
        """As the compiled core reads them."""
        parts = (self.state, self.action, self.reward, self.active)
        return core.Episodes(*(part.contiguous().numpy() for part in parts))


@dataclass(frozen=True, eq=False)
class Sampler:
    """A task batch laid out for sampling.

    Attributes:
        tasks: N of them.
        horizon: T.
    """

    tasks: Tasks
    horizon: int


def sampler(tasks: TaskBatch) -> Sampler:
    """Lay out a task batch."""
    return Sampler(core_tasks(tasks, tasks.discount), tasks.horizon)


def rollout(policy: Tensor, tasks: Sampler, num_episodes: int, generator: torch.Generator) -> Episodes:
    """Sample episodes of every task with a policy.

    Args:
        policy: float [N, S, A], a distribution over the enabled actions, 0 at the others.
        tasks: what to act on.
        num_episodes: B.
        generator: source of randomness.
    """
    shape = (len(policy), num_episodes, tasks.horizon + 1)
    return drawn_episodes(policy, tasks, torch.rand(shape, generator=generator, dtype=policy.dtype))


def drawn_episodes(policy: Tensor, tasks: Sampler, draws: Tensor) -> Episodes:
    """The episodes that draws lead to, by inversion.

    Args:
        policy: as in `rollout`.
        tasks: what to act on.
        draws: float [N, B, T + 1] in [0, 1): of the initial state, then one for each step.
    """
    sampled = core.rollout(array_of(policy), tasks.tasks, array_of(draws))
    return Episodes(*map(torch.from_numpy, sampled))
