"""Search policies by exact policy gradient on known models, without meta-learning (the baselines).

The policy that is evaluated has a uniform part that falls to 0: early on every state is visited, so
that no way of earning is out of the gradient's sight.

Axes: N tasks, S states, A actions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from merap.learning.exact import expected_return
from merap.learning.policy import (
    Parameters,
    PolicyNetwork,
    action_logits,
    explore,
    initial_parameters,
    log_policy,
    policy_table,
    stack_parameters,
)
from merap.learning.tasks import TaskBatch
from merap.learning.threads import one_thread


@dataclass(frozen=True)
class SearchSettings:
    """How a policy is searched for.

    Attributes:
        updates: steps of Adam.
        learning_rate: falls to a tenth of itself along a cosine.
        exploration: uniform part of the policy at the beginning; falls to 0.
        entropies: for `joint_parameters`, weights tried for the policy's mean entropy over all states at the
            beginning, in units of the range of expected rewards; each falls to 0, and the best of the
            policies is kept. Without entropy one policy for the running example's goals ends at the
            nearest (-22.6 on average; with 0.5: -15.9), with much of it none is found for the paper's
            obstacles (RQ1-2 with 0.5: -8.8; with 0.05: -1.3).
        tasks_per_update: for `joint_parameters`, models drawn for an update, at most all.
        seed: seed of parameters and draws.
    """

    updates: int = 200
    learning_rate: float = 0.02
    exploration: float = 0.5
    entropies: tuple[float, ...] = (0.5, 0.05, 0.0)
    tasks_per_update: int = 64
    seed: int = 0


def separate_parameters(network: PolicyNetwork, tasks: TaskBatch, settings: SearchSettings) -> Parameters:
    """Find a policy for each task that is good there; the result for a task does not depend on the others.

    Returns:
        [N, ...].
    """
    drawn = torch.Generator().manual_seed(settings.seed)
    start = stack_parameters(initial_parameters(network, drawn, tasks.dtype), tasks.num_tasks)
    parameters = {name: value.clone() for name, value in start.items()}

    def loss(progress: float) -> Tensor:
        return -_returns(network, parameters, tasks, settings, progress).sum()

    return _minimised(parameters, loss, settings)


def joint_parameters(network: PolicyNetwork, tasks: TaskBatch, settings: SearchSettings) -> Parameters:
    """Find one policy whose mean return over all tasks is good.

    Returns:
        [...].
    """
    found = [_joint(network, tasks, settings, entropy) for entropy in settings.entropies]
    return max(found, key=lambda parameters: _mean_return(network, parameters, tasks, settings))


def _joint(network: PolicyNetwork, tasks: TaskBatch, settings: SearchSettings, entropy: float) -> Parameters:
    drawn = torch.Generator().manual_seed(settings.seed)
    parameters = initial_parameters(network, drawn, tasks.dtype)
    size = min(settings.tasks_per_update, tasks.num_tasks)
    weight = entropy * (tasks.expected_reward.max() - tasks.expected_reward.min())

    def loss(progress: float) -> Tensor:
        some = tasks
        if size < tasks.num_tasks:
            some = tasks[torch.randperm(tasks.num_tasks, generator=drawn)[:size]]
        stacked = stack_parameters(parameters, size)
        earned = _returns(network, stacked, some, settings, progress).mean()
        return -earned - (1 - progress) * weight * _entropy(network, stacked, some)

    return _minimised(parameters, loss, settings)


def _mean_return(
    network: PolicyNetwork, parameters: Parameters, tasks: TaskBatch, settings: SearchSettings
) -> float:
    """Return the exact mean over all tasks without exploration; as many at once as the search has."""
    total = 0.0
    with torch.no_grad():
        for first in range(0, tasks.num_tasks, settings.tasks_per_update):
            some = tasks[first : first + settings.tasks_per_update]
            stacked = stack_parameters(parameters, some.num_tasks)
            total += float(_returns(network, stacked, some, settings, 1.0).sum())
    return total / tasks.num_tasks


def _returns(
    network: PolicyNetwork,
    parameters: Parameters,
    tasks: TaskBatch,
    settings: SearchSettings,
    progress: float,
) -> Tensor:
    """Return float [N], exact discounted returns with the exploration that is left."""
    table = policy_table(network, parameters, tasks.enabled)
    return expected_return(explore(table, tasks.enabled, settings.exploration * (1 - progress)), tasks)


def _entropy(network: PolicyNetwork, parameters: Parameters, tasks: TaskBatch) -> Tensor:
    """Return float [], the mean over tasks and states, in nats."""
    log_probs = log_policy(action_logits(network, parameters), tasks.enabled)
    return -(log_probs.exp() * log_probs * tasks.enabled).sum(dim=-1).mean()


def _minimised(
    parameters: Parameters, loss: Callable[[float], Tensor], settings: SearchSettings
) -> Parameters:
    """Return the parameters after Adam; `loss` is given how much of the search is done, in [0, 1)."""
    for leaf in parameters.values():
        leaf.requires_grad_()
    optimizer = torch.optim.Adam(parameters.values(), lr=settings.learning_rate)
    with one_thread():
        for update in range(settings.updates):
            progress = update / settings.updates
            for group in optimizer.param_groups:
                group["lr"] = settings.learning_rate * (0.55 + 0.45 * math.cos(math.pi * progress))
            optimizer.zero_grad()
            loss(progress).backward()  # type: ignore[no-untyped-call]
            optimizer.step()
    return {name: value.detach() for name, value in parameters.items()}
