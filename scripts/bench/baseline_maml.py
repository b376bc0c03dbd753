"""What merap's learner is timed against: baseline_maml.py [CASE] [--updates n] [--json FILE].

Algorithm 1 as somebody would write it who knows Gymnasium and torch well and nothing else of the
models: episodes from `SyncVectorEnv`, one batched forward pass of the policy for each step of all
environments, and autograd for everything, batched over tasks. The environments are made once, before
anything is timed. Settings are the authors': MAML with TRPO, a linear feature baseline.

Axes: N tasks, B episodes, T steps, M = B T steps of a task, S states, A actions, F features.
"""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import torch
import typer
from gymnasium.vector import SyncVectorEnv
from torch import Tensor

from merap.families.build import build_base
from merap.families.loading import load_case
from merap.learning.policy import Parameters
from scripts.bench.baseline_episodes import (
    Settings,
    Steps,
    World,
    initial_policy,
    log_probs,
    make_world,
    same_environment,
    sample,
)

CASE = Path(__file__).parents[2] / "models" / "paper-grid" / "rq1-1.yaml"


@dataclass
class Times:
    """Seconds of one update by part, and the environment steps that the sampling took."""

    seconds: dict[str, float] = field(default_factory=dict)
    steps: int = 0

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    @property
    def total(self) -> float:
        return sum(self.seconds.values())

    @property
    def steps_per_second(self) -> float:
        return self.steps / self.seconds["sampling"]


def baseline_update(
    world: World, theta: Parameters, settings: Settings, generator: torch.Generator
) -> tuple[Parameters, Times, float]:
    """Take one outer step of Algorithm 1.

    Returns:
        The new theta, the times, and the mean undiscounted return of the adapted policies.
    """
    times = Times()
    theta = {name: value.detach().requires_grad_() for name, value in theta.items()}
    drawn = torch.randperm(len(world.envs), generator=generator)[: settings.tasks].tolist()
    with times.part("sampling"):
        envs = SyncVectorEnv(
            [partial(same_environment, env) for task in drawn for env in world.envs[task]], copy=False
        )
        meta = {name: value.detach().expand(len(drawn), *value.shape) for name, value in theta.items()}
        support = sample(envs, meta, world, settings, generator)
    with times.part("inner step"):
        adapted = {name: value.detach() for name, value in _adapt(theta, support, settings).items()}
    with times.part("sampling"):
        query = sample(envs, adapted, world, settings, generator)
    with times.part("outer step"):
        theta = _trust_region_step(theta, adapted, support, query, settings)
    times.steps = support.count + query.count
    return theta, times, query.mean_return


def _adapt(theta: Parameters, support: Steps, settings: Settings) -> Parameters:
    """Return theta'_i [N, ...], differentiable in theta (`eq:adap`)."""
    num_tasks = len(support.action)
    copies = {name: value.expand(num_tasks, *value.shape) for name, value in theta.items()}
    _, taken = log_probs(copies, support)
    loss = -support.mean(taken * support.advantage).sum()
    gradients = torch.autograd.grad(loss, list(copies.values()), create_graph=True)
    return {
        name: value - settings.step_size * gradient
        for (name, value), gradient in zip(copies.items(), gradients, strict=True)
    }


def _trust_region_step(
    theta: Parameters, adapted: Parameters, support: Steps, query: Steps, settings: Settings
) -> Parameters:
    """Take a step of TRPO through the inner step (Schulman et al. 2015; `eq:meta-opt`)."""
    with torch.no_grad():
        old, old_taken = log_probs(adapted, query)
    old_probs = old.exp()

    def surrogate(candidate: Parameters) -> tuple[Tensor, Tensor]:
        """Return the outer loss, and the KL divergence from the adapted policies that sampled."""
        every, taken = log_probs(_adapt(candidate, support, settings), query)
        loss = -query.mean((taken - old_taken).exp() * query.advantage).mean()
        return loss, query.mean((old_probs * (old - every)).sum(dim=-1)).mean()

    leaves = list(theta.values())
    loss, divergence = surrogate(theta)
    gradient = _flat(torch.autograd.grad(loss, leaves, retain_graph=True))
    of_divergence = _flat(torch.autograd.grad(divergence, leaves, create_graph=True))

    def fisher(vector: Tensor) -> Tensor:
        product = torch.autograd.grad(of_divergence @ vector, leaves, retain_graph=True)
        return _flat(product) + settings.damping * vector

    direction = _conjugate_gradient(fisher, gradient, settings.conjugate_steps)
    length = torch.sqrt(2 * settings.max_kl / (direction @ fisher(direction)))
    for number in range(settings.backtracks):
        candidate = _moved(theta, -(settings.backtrack_ratio**number) * length * direction)
        new_loss, new_divergence = surrogate(candidate)
        if new_loss < loss and new_divergence < settings.max_kl:
            return candidate
    return theta


def _conjugate_gradient(apply: Callable[[Tensor], Tensor], right: Tensor, steps: int) -> Tensor:
    """Solve for a symmetric positive definite matrix that is known by its products."""
    solution, residual = torch.zeros_like(right), right.clone()
    search, square = residual.clone(), residual @ residual
    for _ in range(steps):
        product = apply(search)
        length = square / (search @ product)
        solution = solution + length * search
        residual = residual - length * product
        before, square = square, residual @ residual
        search = residual + square / before * search
    return solution


def _flat(tensors: Sequence[Tensor]) -> Tensor:
    return torch.cat([tensor.flatten() for tensor in tensors])


def _moved(theta: Parameters, change: Tensor) -> Parameters:
    parts = torch.split(change, [value.numel() for value in theta.values()])
    return {
        name: (value + part.view_as(value)).detach().requires_grad_()
        for (name, value), part in zip(theta.items(), parts, strict=True)
    }


def main(
    case: Annotated[Path, typer.Argument(help="A case whose actions are always enabled.")] = CASE,
    updates: Annotated[int, typer.Option(min=1)] = 20,
    threads: Annotated[int, typer.Option(min=1)] = 1,
    seed: int = 0,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    """Time updates of the baseline; medians, in seconds."""
    torch.set_num_threads(threads)
    settings = Settings()
    base = build_base(load_case(case))
    world = make_world(base.models, base.horizons, settings.episodes)
    generator = torch.Generator().manual_seed(seed)
    theta = initial_policy(world, generator)
    measured = []
    for _ in range(updates):
        theta, times, mean_return = baseline_update(world, theta, settings, generator)
        measured.append(times)
        print(f"return {mean_return:6.2f}  {times.total:.3f} s")
    figures = {
        "update": statistics.median(times.total for times in measured),
        "steps_per_second": statistics.median(times.steps_per_second for times in measured),
        **{
            part: statistics.median(times.seconds[part] for times in measured) for part in measured[0].seconds
        },
    }
    print(*(f"{name} {value:.4g}" for name, value in figures.items()), sep="\n")
    if json_file is not None:
        json_file.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    typer.run(main)
