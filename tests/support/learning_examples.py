"""Small task batches and policies for the tests of learning."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from merap.learning.policy import Parameters, PolicyNetwork, initial_parameters
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp.model import Floats, TabularMDP
from tests.support.grid_tasks import DISCOUNT, HORIZON, grid_model, grid_task
from tests.support.hand_made import graph_combination, with_environment, with_objective
from tests.support.placed import models_of

RING_HORIZON = 12
RING_DISCOUNT = 0.9


def ring_models() -> list[TabularMDP]:
    """Three stochastic models of 13 states with disabled actions: the goal open, shut, and another start."""
    ring = graph_combination()
    variants = [
        ring,
        with_environment(ring, blocked=np.array([False, False, False, True])),
        with_objective(ring, start=np.array([0.0, 0.25, 0.75, 0.0])),
    ]
    return models_of(variants)


def grid_models(slip: float) -> list[TabularMDP]:
    """The paper's world with a goal nearby, a goal further away and a cell that can't be entered."""
    tasks = (grid_task((1, 1)), grid_task((2, 2), [(1, 2)]))
    return [grid_model(task, slip) for task in tasks]


def ring_batch(dtype: torch.dtype = torch.float64) -> TaskBatch:
    return task_batch(ring_models(), RING_HORIZON, RING_DISCOUNT, dtype)


def grid_batch(slip: float = 0.0, dtype: torch.dtype = torch.float64) -> TaskBatch:
    return task_batch(grid_models(slip), HORIZON, DISCOUNT, dtype)


def dense(tasks: TaskBatch, of_branches: Tensor) -> Tensor:
    """Return float64 [N, S, A, S], numbers of branches [B] where these lead to, added up."""
    shape = (*tasks.enabled.shape, tasks.num_states)
    number, choice, _, target = tasks.branches
    place = choice * tasks.num_states + target % tasks.num_states
    table = torch.zeros(math.prod(shape), dtype=torch.float64)
    return table.index_add_(0, place, of_branches[number].double()).view(shape)


def with_horizon(tasks: TaskBatch, horizon: int | list[int]) -> TaskBatch:
    return replace(tasks, horizon=torch.as_tensor(horizon).expand(tasks.num_tasks).clone())


def random_table(enabled: Tensor, seed: int) -> Tensor:
    """Return float64 [N, S, A], a random distribution over the enabled actions; 0 where there is none."""
    drawn = torch.rand(enabled.shape, generator=seeded(seed), dtype=torch.float64) * enabled
    return drawn / drawn.sum(dim=-1, keepdim=True).clamp_min(1e-300)


def with_end(policy: Tensor, model: TabularMDP) -> Floats:
    """float64 [S, A + 1] of a policy [S, A]: `end` where it is the only choice."""
    end: Floats = model.enabled[:, -1:].astype(np.float64)
    return np.hstack([policy.double().numpy(), end])


def smooth_network(tasks: TaskBatch, hidden: tuple[int, ...] = (4,)) -> PolicyNetwork:
    """A network whose loss has derivatives of every order."""
    return PolicyNetwork(tasks.num_states, tasks.num_actions, hidden, "softplus")


def random_parameters(network: PolicyNetwork, seed: int) -> Parameters:
    """float64 parameters with biases other than 0."""
    generator = seeded(seed)
    parameters = initial_parameters(network, generator, torch.float64)
    return {
        name: value + 0.3 * torch.randn(value.shape, generator=generator, dtype=torch.float64)
        for name, value in parameters.items()
    }


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)
