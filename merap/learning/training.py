"""The offline phase: meta-train over a base (the paper's Algorithm 1).

Axes: P parameters in one row, L layers.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from merap.errors import ModelError
from merap.learning.config import TrainingConfig
from merap.learning.exact import require_span
from merap.learning.meta import MetaPolicy, step_rule
from merap.learning.objective import OuterObjective, outer_objective
from merap.learning.optimizer import Optimizer
from merap.learning.policy import PolicyNetwork, flat, initial_parameters, shaped
from merap.learning.progress import Progress, UpdateMetrics
from merap.learning.tasks import TaskBatch
from merap.learning.threads import one_thread
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
    optimizer: Optimizer
    generator: torch.Generator
    progress: Progress
    best: Best | None = None
    diverged: bool = False


@dataclass(frozen=True)
class TrainingOutcome:
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


def _optimizer(theta: Tensor, log_step_sizes: Tensor, config: TrainingConfig) -> Optimizer:
    rates = (config.learning_rate, config.step_size_learning_rate)
    if config.outer == "trpo":
        return Optimizer([log_step_sizes], rates[1:], adaptive=True)
    return Optimizer([theta, log_step_sizes], rates, adaptive=config.outer == "adam")


def updates(tasks: TaskBatch, config: TrainingConfig, state: TrainingState) -> Iterator[UpdateMetrics]:
    """Go on with a training run, an update at a time; `state` is current after each.

    Raises:
        InputError: returns over the configured span have no value.
        ModelError: the gradient is no number, and there is no policy to keep.
    """
    require_span(config.span, tasks.discount)
    network = policy_network(tasks, config)
    size = min(config.tasks_per_update, tasks.num_tasks)
    threads = torch.get_num_threads()
    objective = outer_objective(tasks, network, config, threads)
    while state.update < config.updates and not _on_plateau(state, config):
        begin = time.perf_counter()
        with one_thread():
            if size < tasks.num_tasks:  # distinct ones, uniformly (the paper's P(M))
                drawn = torch.randperm(tasks.num_tasks, generator=state.generator)[:size]
                objective = outer_objective(tasks[drawn], network, config, threads)
            metrics = _update(objective, tasks.discount, config, state, begin)
        if metrics is None:
            return
        yield metrics


def _on_plateau(state: TrainingState, config: TrainingConfig) -> bool:
    return 0 < config.patience <= state.progress.since_best


@torch.no_grad()
def _update(
    objective: OuterObjective, discount: float, config: TrainingConfig, state: TrainingState, begin: float
) -> UpdateMetrics | None:
    """Do one update; None if its gradient is no number."""
    theta, log_sizes = state.theta, state.log_step_sizes
    rule = step_rule(config, discount).advantage_rule(state.variance)
    drawn, seen, found = objective.draw(theta, log_sizes, rule, config, state.generator)
    variance = seen.variance.mean().item()
    objective, known = objective.on_counting_states(drawn)
    part = objective.counting(theta)
    found = found or objective.gradient(part, log_sizes, known)
    weight = _entropy_weight(config, state.update) * math.sqrt(max(variance, 0.0))
    if weight > 0:
        found = found._replace(theta=found.theta + weight * objective.entropy_gradient(part, known))
    norm = _norm(found.theta, found.sizes)
    if not math.isfinite(norm):
        _give_up(state)
        return None
    rate = _set_learning_rates(state, config)
    kl = length = math.nan
    for repeat in range(config.outer_repeats):
        if repeat:
            part = objective.counting(theta)
            found = objective.gradient(part, log_sizes, known)
        if config.outer == "trpo":
            moved = trust_region_step(objective, part, log_sizes, found.theta, known, config)
            kl, length = moved.kl, moved.length
            theta.copy_(objective.spread(moved.theta, theta))
        rows = (objective.spread(found.theta, torch.zeros_like(theta)), found.sizes)
        _ascend(state, rows, _norm(*found) if repeat else norm, config)
    adapted_return = seen.adapted_return.mean().item()
    _remember(state, variance, adapted_return)
    return UpdateMetrics(
        update=state.update,
        meta_return=seen.meta_return.mean().item(),
        adapted_return=adapted_return,
        entropy=seen.entropy.mean().item(),
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
    rates = [config.learning_rate * part, config.step_size_learning_rate * part]
    state.optimizer.rates = rates[-len(state.optimizer.rates) :]
    return rates[0]


def _ascend(state: TrainingState, rows: Sequence[Tensor], norm: float, config: TrainingConfig) -> None:
    """Let the optimizer, which descends, step on all that it is for; the gradient is cut to a norm."""
    scale = -min(1.0, config.max_gradient_norm / max(norm, LEAST_NORM))
    moving = rows[-len(state.optimizer.rates) :]
    state.optimizer.step([scale * row for row in moving])


def _norm(gradient: Tensor, of_sizes: Tensor) -> float:
    return math.hypot(gradient.norm().item(), of_sizes.norm().item())


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


def outcome(config: TrainingConfig, state: TrainingState) -> TrainingOutcome:
    """How a run that has ended has ended."""
    progress = state.progress
    collapsed = progress.collapsed or state.diverged
    return TrainingOutcome(
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
