"""The offline phase: meta-train over a base (the paper's Algorithm 1 with exact gradients)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.meta import Batch, MetaPolicy, batch, objective, step_rule
from merap.learning.policy import Parameters, PolicyNetwork, initial_parameters
from merap.learning.tasks import TaskBatch

# The running mean of the advantages' variance looks back about that many updates.
_VARIANCE_MEMORY = 20


@dataclass(frozen=True)
class UpdateMetrics:
    """What one outer update showed.

    Attributes:
        update: counted from 1.
        meta_return: mean expected discounted return of the meta policy on the batch.
        adapted_return: that of the policies after their inner steps.
        entropy: mean entropy of the meta policy over states, in nats.
        gradient_norm: of the outer gradient, before it is cut.
        learning_rate: of the meta policy.
        seconds: wall-clock time of the update.
    """

    update: int
    meta_return: float
    adapted_return: float
    entropy: float
    gradient_norm: float
    learning_rate: float
    seconds: float


@dataclass(eq=False)
class TrainingState:
    """Everything that a training run is at one moment; changed in place by `updates`.

    Attributes:
        update: outer updates done.
        parameters: theta, leaves.
        log_step_sizes: log alpha, leaves.
        variance: float [], running mean of the advantages' variance; None before the first.
        optimizer: of both.
        generator: source of all randomness.
    """

    update: int
    parameters: Parameters
    log_step_sizes: Parameters
    variance: Tensor | None
    optimizer: torch.optim.Adam
    generator: torch.Generator


def policy_network(tasks: TaskBatch, config: TrainingConfig) -> PolicyNetwork:
    """The shape of the policy that a configuration asks for."""
    features = tasks.features if config.observation == "factored" else None
    return PolicyNetwork(tasks.num_states, tasks.num_actions, config.hidden, config.activation, features)


def initial_state(network: PolicyNetwork, config: TrainingConfig) -> TrainingState:
    """The state before the first update."""
    generator = torch.Generator().manual_seed(config.seed)
    parameters = initial_parameters(network, generator)
    start = math.log(config.step_size)
    log_step_sizes = {
        name: torch.full((1,) * value.dim(), start, dtype=value.dtype) for name, value in parameters.items()
    }
    for leaf in (*parameters.values(), *log_step_sizes.values()):
        leaf.requires_grad_()
    groups = [
        {"params": list(parameters.values()), "lr": config.learning_rate},
        {"params": list(log_step_sizes.values()), "lr": config.step_size_learning_rate},
    ]
    return TrainingState(0, parameters, log_step_sizes, None, torch.optim.Adam(groups), generator)


def updates(tasks: TaskBatch, config: TrainingConfig, state: TrainingState) -> Iterator[UpdateMetrics]:
    """Go on with a training run, an update at a time; `state` is current after each."""
    network = policy_network(tasks, config)
    size = min(config.tasks_per_update, tasks.num_tasks)
    whole = batch(tasks) if size == tasks.num_tasks else None
    while state.update < config.updates:
        begin = time.perf_counter()
        drawn = whole if whole is not None else _draw(tasks, size, state.generator)
        _set_learning_rates(state, config)
        yield _update(network, drawn, config, state, begin)


def _draw(tasks: TaskBatch, size: int, generator: torch.Generator) -> Batch:
    """Distinct tasks, uniformly (the paper's P(M))."""
    return batch(tasks[torch.randperm(tasks.num_tasks, generator=generator)[:size]])


def _set_learning_rates(state: TrainingState, config: TrainingConfig) -> None:
    cosine = (1 + math.cos(math.pi * state.update / config.updates)) / 2
    part = config.final_learning_rate + (1 - config.final_learning_rate) * cosine
    rates = (config.learning_rate, config.step_size_learning_rate)
    for group, rate in zip(state.optimizer.param_groups, rates, strict=True):
        group["lr"] = rate * part


def _update(
    network: PolicyNetwork, drawn: Batch, config: TrainingConfig, state: TrainingState, begin: float
) -> UpdateMetrics:
    found = objective(
        network, state.parameters, state.log_step_sizes, state.variance, drawn, config, state.generator
    )
    leaves = [*state.parameters.values(), *state.log_step_sizes.values()]
    state.optimizer.zero_grad()
    weight = _entropy_weight(config, state.update) * found.variance.detach().sqrt()
    (-found.adapted_return - weight * found.entropy).backward()  # type: ignore[no-untyped-call]
    norm = torch.nn.utils.clip_grad_norm_(leaves, config.max_gradient_norm)
    state.optimizer.step()
    state.update += 1
    state.variance = _running_mean(state.variance, found.variance, state.update)
    return UpdateMetrics(
        update=state.update,
        meta_return=found.meta_return.item(),
        adapted_return=found.adapted_return.item(),
        entropy=found.entropy.item(),
        gradient_norm=norm.item(),
        learning_rate=state.optimizer.param_groups[0]["lr"],
        seconds=time.perf_counter() - begin,
    )


def _entropy_weight(config: TrainingConfig, update: int) -> float:
    left = 1 - update / config.updates
    return config.entropy * (config.final_entropy + (1 - config.final_entropy) * left)


def _running_mean(mean: Tensor | None, value: Tensor, count: int) -> Tensor:
    if mean is None:
        return value
    return mean + (value - mean) / min(count, _VARIANCE_MEMORY)


def meta_policy(tasks: TaskBatch, config: TrainingConfig, state: TrainingState) -> MetaPolicy:
    """What a training run has learned so far."""
    assert state.variance is not None, "no update was done"
    return MetaPolicy(
        network=policy_network(tasks, config),
        parameters={name: value.detach().clone() for name, value in state.parameters.items()},
        step_sizes={name: value.detach().exp() for name, value in state.log_step_sizes.items()},
        variance=state.variance.detach().clone(),
        rule=step_rule(config, tasks.discount),
    )


def train(
    tasks: TaskBatch,
    config: TrainingConfig,
    on_update: Callable[[UpdateMetrics], None] = lambda metrics: None,
) -> MetaPolicy:
    """Train a meta policy.

    Args:
        tasks: the base.
        config: every setting.
        on_update: called after each update.
    """
    state = initial_state(policy_network(tasks, config), config)
    for metrics in updates(tasks, config, state):
        on_update(metrics)
    return meta_policy(tasks, config, state)
