"""The offline phase: meta-train over a base (the paper's Algorithm 1).

Axes: P parameters in one row, L layers.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from merap.errors import ModelError
from merap.learning.config import TrainingConfig
from merap.learning.core.jit import Array
from merap.learning.exact import require_span
from merap.learning.layout import array_of, core_network, core_tasks, flat, shaped
from merap.learning.meta import MetaPolicy, Objective, outer_objective, ranges, step_rule
from merap.learning.metrics import UpdateMetrics
from merap.learning.optimizer import step
from merap.learning.policy import PolicyNetwork, initial_parameters
from merap.learning.progress import Progress
from merap.learning.tasks import TaskBatch
from merap.learning.threads import one_blas_thread, one_thread
from merap.learning.trust_region import trust_region_step

# The running mean of the advantages' variance looks back about that many updates.
_VARIANCE_MEMORY = 20
LEAST_NORM = 1e-12


@dataclass(frozen=True, eq=False)
class Best:
    """The policy at the end of the best window.

    Attributes:
        theta: float [P].
        log_step_sizes: float [2 L].
        variance: float [].
    """

    theta: Tensor
    log_step_sizes: Tensor
    variance: Tensor


@dataclass(eq=False)
class TrainingState:
    """Everything that a training run is at one moment; changed in place by `updates`.

    Attributes:
        update: outer updates done.
        theta: float [P], a leaf.
        log_step_sizes: float [2 L], log alpha of each weight and bias, a leaf.
        variance: float [], running mean of the advantages' variance; None before the first.
        optimizer: of both; of log alpha alone, where theta moves by trust regions.
        generator: source of all randomness.
        progress: what the adapted returns so far amount to.
        best: the policy of the best window; None before the first is full.
        diverged: a gradient was no number: training is over.
    """

    update: int
    theta: Tensor
    log_step_sizes: Tensor
    variance: Tensor | None
    optimizer: torch.optim.Optimizer
    generator: torch.Generator
    progress: Progress
    best: Best | None = None
    diverged: bool = False


@dataclass(frozen=True)
class Outcome:
    """How a training run ended.

    Attributes:
        updates: done.
        kept: the update whose policy was kept.
        stopped: it ended early: on a plateau, or since it had diverged.
        collapsed: the return fell, or the gradient became no number, so that an earlier policy was kept.
        best_score: mean adapted return of the best window; nan if no window was full.
        last_score: likewise, of the last window.
    """

    updates: int
    kept: int
    stopped: bool
    collapsed: bool
    best_score: float
    last_score: float


def policy_network(tasks: TaskBatch, config: TrainingConfig) -> PolicyNetwork:
    """The shape of the policy that a configuration asks for."""
    features = tasks.features if config.observation == "factored" else None
    return PolicyNetwork(tasks.num_states, tasks.num_actions, config.hidden, config.activation, features)


def initial_state(
    network: PolicyNetwork, config: TrainingConfig, dtype: torch.dtype = torch.float32
) -> TrainingState:
    """The state before the first update."""
    generator = torch.Generator().manual_seed(config.seed)
    theta = flat(initial_parameters(network, generator, dtype))
    log_step_sizes = torch.full((2 * network.num_layers,), math.log(config.step_size), dtype=dtype)
    optimizer = _optimizer(theta, log_step_sizes, config)
    return TrainingState(
        0, theta, log_step_sizes, None, optimizer, generator, Progress(least_gain=config.least_gain)
    )


def _optimizer(theta: Tensor, log_step_sizes: Tensor, config: TrainingConfig) -> torch.optim.Optimizer:
    of_sizes = {"params": [log_step_sizes], "lr": config.step_size_learning_rate}
    of_theta = {"params": [theta], "lr": config.learning_rate}
    if config.outer == "trpo":
        return torch.optim.Adam([of_sizes])
    if config.outer == "sgd":
        return torch.optim.SGD([of_theta, of_sizes])
    return torch.optim.Adam([of_theta, of_sizes])


def updates(tasks: TaskBatch, config: TrainingConfig, state: TrainingState) -> Iterator[UpdateMetrics]:
    """Go on with a training run, an update at a time; `state` is current after each.

    Until it ends or is closed, products in this process use one thread each.

    Raises:
        InputError: returns over the configured span have no value.
        ModelError: the gradient is no number, and there is no policy to keep.
    """
    require_span(config.span, tasks.discount)
    everything = core_tasks(tasks, tasks.discount)
    network = core_network(policy_network(tasks, config), tasks.dtype)
    rule = step_rule(config, tasks.discount)
    size = min(config.tasks_per_update, tasks.num_tasks)
    whole = ranges(everything, network)
    with one_blas_thread():
        while state.update < config.updates and not _on_plateau(state, config):
            begin = time.perf_counter()
            parts = whole
            if size < tasks.num_tasks:  # distinct ones, uniformly (the paper's P(M))
                drawn = torch.randperm(tasks.num_tasks, generator=state.generator)[:size].numpy()
                parts = ranges(everything.some(drawn), network)
            problem = partial(
                outer_objective,
                parts,
                network,
                rule=rule,
                variance=state.variance,
                config=config,
                horizon=tasks.horizon,
                threads=torch.get_num_threads(),
            )
            with one_thread():  # torch's own would wait for work in a loop, on the core of ours
                metrics = _update(problem, tasks.horizon, config, state, begin)
            if metrics is None:
                return
            yield metrics


def _on_plateau(state: TrainingState, config: TrainingConfig) -> bool:
    return 0 < config.patience <= state.progress.since_best


@torch.no_grad()
def _update(
    of_step_sizes: Callable[[Array], Objective],
    horizon: int,
    config: TrainingConfig,
    state: TrainingState,
    begin: float,
) -> UpdateMetrics | None:
    """One update; None if its gradient is no number."""
    theta, objective = array_of(state.theta), of_step_sizes(np.exp(array_of(state.log_step_sizes)))
    found, drawn, seen = objective.draw_and_differentiate(theta, config, horizon, state.generator)
    variance = float(seen.variance.mean())
    weight = theta.dtype.type(_entropy_weight(config, state.update) * math.sqrt(variance))
    gradient: Array = found.theta + weight * found.entropy
    of_sizes = found.sizes
    norm = _norm(gradient, of_sizes)
    if not math.isfinite(norm):
        _give_up(state)
        return None
    rate = _set_learning_rates(state, config)
    kl = length = math.nan
    for repeat in range(config.outer_repeats):
        if repeat:
            theta, objective = array_of(state.theta), of_step_sizes(np.exp(array_of(state.log_step_sizes)))
            again = objective.differentiate_again(theta, drawn)
            gradient, of_sizes = again.theta, again.sizes
        if config.outer == "trpo":
            moved = trust_region_step(objective, theta, gradient, drawn, config)
            kl, length = moved.kl, moved.length
            state.theta.copy_(torch.from_numpy(moved.theta))
        _ascend(state, gradient, of_sizes, config)
    _remember(state, variance, float(seen.adapted_return.mean()))
    return UpdateMetrics(
        update=state.update,
        meta_return=float(seen.meta_return.mean()),
        adapted_return=float(seen.adapted_return.mean()),
        entropy=float(seen.entropy.mean()),
        gradient_norm=norm,
        learning_rate=math.nan if config.outer == "trpo" else rate,
        kl=kl,
        step_length=length,
        variance=variance,
        seconds=time.perf_counter() - begin,
    )


def _give_up(state: TrainingState) -> None:
    state.diverged = True
    if state.best is None:
        raise ModelError(
            f"the gradient of update {state.update + 1} is no number; a lower learning rate may help"
        )


def _set_learning_rates(state: TrainingState, config: TrainingConfig) -> float:
    """Along the cosine; that of theta."""
    cosine = (1 + math.cos(math.pi * state.update / config.updates)) / 2
    part = config.final_learning_rate + (1 - config.final_learning_rate) * cosine
    rates = (config.learning_rate * part, config.step_size_learning_rate * part)
    groups = state.optimizer.param_groups
    for group, rate in zip(groups, rates[-len(groups) :], strict=True):
        group["lr"] = rate
    return rates[0]


def _ascend(state: TrainingState, gradient: Array, of_sizes: Array, config: TrainingConfig) -> None:
    """A step of the optimizer, which descends, on all that it is for."""
    scale = min(1.0, config.max_gradient_norm / max(_norm(gradient, of_sizes), LEAST_NORM))
    downhill = gradient.dtype.type(-scale)
    state.theta.grad = torch.from_numpy(downhill * gradient)
    state.log_step_sizes.grad = torch.from_numpy(downhill * of_sizes)
    step(state.optimizer)


def _norm(gradient: Array, of_sizes: Array) -> float:
    return math.hypot(float(np.linalg.norm(gradient)), float(np.linalg.norm(of_sizes)))


def _remember(state: TrainingState, variance: float, adapted_return: float) -> None:
    state.update += 1
    mean = variance if state.variance is None else state.variance.item()
    mean += (variance - mean) / min(state.update, _VARIANCE_MEMORY)
    state.variance = torch.tensor(mean, dtype=state.theta.dtype)
    if state.progress.observe(adapted_return):
        copies = state.theta.detach().clone(), state.log_step_sizes.detach().clone()
        state.best = Best(*copies, state.variance.clone())


def _entropy_weight(config: TrainingConfig, update: int) -> float:
    left = 1 - update / config.updates
    return config.entropy * (config.final_entropy + (1 - config.final_entropy) * left)


def outcome(config: TrainingConfig, state: TrainingState) -> Outcome:
    """How a run that has ended has ended."""
    progress = state.progress
    collapsed = progress.collapsed or state.diverged
    return Outcome(
        updates=state.update,
        kept=progress.best_update if collapsed else state.update,
        stopped=state.update < config.updates,
        collapsed=collapsed,
        best_score=progress.best_score,
        last_score=progress.score,
    )


def meta_policy(tasks: TaskBatch, config: TrainingConfig, state: TrainingState) -> MetaPolicy:
    """What a training run has learned so far: its last policy, or the best if it has collapsed."""
    assert state.variance is not None, "no update was done"
    kept = Best(state.theta, state.log_step_sizes, state.variance)
    if state.best is not None and outcome(config, state).collapsed:
        kept = state.best
    network = policy_network(tasks, config)
    parameters = shaped(kept.theta.detach(), network)
    step_sizes = dict(zip(parameters, kept.log_step_sizes.detach().exp(), strict=True))
    return MetaPolicy(
        network=network,
        parameters={name: value.clone() for name, value in parameters.items()},
        step_sizes={name: value.view((1,) * parameters[name].dim()) for name, value in step_sizes.items()},
        variance=kept.variance.clone(),
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
    state = initial_state(policy_network(tasks, config), config, tasks.dtype)
    for metrics in updates(tasks, config, state):
        on_update(metrics)
    return meta_policy(tasks, config, state)
