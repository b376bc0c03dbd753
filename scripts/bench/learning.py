"""Measure the cost and the quality of learning: scripts.bench learning."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import torch
import typer

from merap.families.build import build_base
from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.learning.episodes import rollout
from merap.learning.exact import expected_return
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy, step_rule
from merap.learning.models import train_tasks
from merap.learning.policy import Parameters, PolicyNetwork, policy_table, stack_parameters
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.training import initial_state, meta_policy, policy_network, updates
from scripts.bench import baseline_episodes, baseline_maml
from scripts.bench.tables import Json, figures_by_name, show, write_figures

FOR_EVER = 1_000_000_000
Figures = dict[str, float]


def learning(
    json_file: Json = None,
    rounds: Annotated[int, typer.Option(help="Updates of the baseline.")] = 30,
    training_seeds: Annotated[int, typer.Option(help="Trainings for the comparison of quality.")] = 5,
) -> None:
    """Time updates against a baseline on SyncVectorEnv, side by side; time to equal adaptation quality."""
    base = build_base(load_case(baseline_maml.CASE))
    tasks = task_batch(base.models, base.horizons, base.discount)
    world = baseline_episodes.make_world(base.models, base.horizons, baseline_episodes.Settings().episodes)
    figures = _speed(world, tasks, rounds) | _quality(world, tasks, rounds, training_seeds)
    report(f"learning on {base.case}", figures, json_file)


def _speed(world: baseline_episodes.World, tasks: TaskBatch, rounds: int) -> Figures:
    """Return medians of updates that take turns."""
    settings, generator = baseline_episodes.Settings(), torch.Generator().manual_seed(0)
    theta = baseline_episodes.initial_policy(world, generator)
    exact = _endless(tasks, TrainingConfig(updates=FOR_EVER))
    sampled = _endless(tasks, TrainingConfig(estimator="sampled", updates=FOR_EVER))
    seconds: dict[str, list[float]] = {"baseline": [], "exact": [], "sampled": []}
    rates = []
    for update in range(rounds + 1):
        theta, times, _ = baseline_maml.baseline_update(world, theta, settings, generator)
        turns = [("sampled", next(sampled)) for _ in range(5)] + [("exact", next(exact)) for _ in range(20)]
        if update:  # the first of each compiles, allocates and imports
            seconds["baseline"].append(times.total)
            rates.append(times.steps_per_second)
            for name, took in turns:
                seconds[name].append(took)
    medians = {f"{name}_update_seconds": statistics.median(row) for name, row in seconds.items()}
    return {
        **medians,
        "baseline_steps_per_second": statistics.median(rates),
        "sampled_times_faster": medians["baseline_update_seconds"] / medians["sampled_update_seconds"],
        "exact_times_faster": medians["baseline_update_seconds"] / medians["exact_update_seconds"],
    }


def _endless(tasks: TaskBatch, config: TrainingConfig) -> Iterator[float]:
    """Yield the seconds of one update after the other."""
    state = initial_state(policy_network(tasks, config), config)
    return (metrics.seconds for metrics in updates(tasks, config, state))


def _quality(world: baseline_episodes.World, tasks: TaskBatch, rounds: int, seeds: int) -> Figures:
    """Time training until a policy adapts as well as the baseline's after its updates, in one process.

    Adaptation quality is the mean expected undiscounted return over all tasks after three plain gradient
    steps of 35 episodes, the same for every learner.
    """
    generator = torch.Generator().manual_seed(1)
    theta, spent = baseline_episodes.initial_policy(world, generator), 0.0
    for _ in range(max(rounds, 80)):
        theta, times, _ = baseline_maml.baseline_update(world, theta, baseline_episodes.Settings(), generator)
        spent += times.total
    goal = _adapted_return(_plain(tasks, theta), tasks)
    reached = [_seconds_to(goal, tasks, seed, "exact") for seed in range(seeds)]
    sampled = [_seconds_to(goal, tasks, seed, "sampled") for seed in range(seeds)]
    silent = [
        _adapted_return(train_tasks(tasks, TrainingConfig(seed=seed, sampling_noise=noise)), tasks)
        for noise in (True, False)
        for seed in range(seeds)
    ]
    return {
        "quality_of_baseline": goal,
        "baseline_seconds_to_quality": spent,
        "exact_seconds_to_quality": statistics.median(reached),
        "sampled_seconds_to_quality": statistics.median(sampled),
        "quality_of_exact": statistics.mean(silent[:seeds]),
        "quality_of_exact_without_sampling_noise": statistics.mean(silent[seeds:]),
    }


def _seconds_to(goal: float, tasks: TaskBatch, seed: int, estimator: str) -> float:
    """Return training time alone until the policy adapts at least that well; infinite if it never does."""
    config = TrainingConfig.model_validate({"seed": seed, "estimator": estimator, "updates": 200})
    state, spent = initial_state(policy_network(tasks, config), config), 0.0
    for metrics in updates(tasks, config, state):
        spent += metrics.seconds
        if metrics.update % 10 == 0 and _adapted_return(meta_policy(tasks, config, state), tasks) >= goal:
            return spent
    return float("inf")


def _plain(tasks: TaskBatch, theta: Parameters) -> MetaPolicy:
    """Return the baseline's policy with its own step size and rule."""
    config = TrainingConfig(estimator="sampled")
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, config.hidden, config.activation)
    sizes = {name: torch.full((1,) * value.dim(), config.step_size) for name, value in theta.items()}
    parameters = {name: value.detach() for name, value in theta.items()}
    return MetaPolicy(network, parameters, sizes, torch.tensor(1.0), step_rule(config, tasks.discount))


def _adapted_return(meta: MetaPolicy, tasks: TaskBatch) -> float:
    """Return the mean over all tasks and 5 seeds."""
    undiscounted, returns = replace(tasks, discount=1.0), []
    for seed in range(5):
        generator = torch.Generator().manual_seed(1_000 + seed)
        parameters = stack_parameters(meta.parameters, tasks.num_tasks)
        for _ in range(3):
            acting = behaviour(meta.network, parameters, tasks.enabled, meta.rule)
            episodes = rollout(acting, tasks, 35, generator)
            parameters = sampled_step(
                meta.network, parameters, meta.step_sizes, tasks.enabled, episodes, meta.rule, meta.variance
            ).parameters
        table = policy_table(meta.network, parameters, tasks.enabled)
        returns.append(expected_return(table, undiscounted).mean().item())
    return statistics.mean(returns)


def median(run: Callable[[], object], repeats: int) -> float:
    """Return the median of the seconds of some calls."""
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def report(title: str, figures: Figures, json_file: Path | None) -> None:
    """Show a table, and write the figures by name."""
    show(figures_by_name(title, figures))
    write_figures(json_file, figures)
