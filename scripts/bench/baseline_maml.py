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
from torch.nn.functional import embedding, one_hot

from merap.concerns.case_study import load_case
from merap.errors import InputError
from merap.families.build import build_base
from merap.learning.policy import Parameters, PolicyNetwork, initial_parameters
from merap.mdp.gymnasium_env import MDPEnv
from merap.mdp.model import TabularMDP

CASE = Path(__file__).parents[2] / "models" / "paper-grid" / "rq1-1.yaml"


@dataclass(frozen=True)
class Settings:
    """The authors' settings."""

    tasks: int = 10
    episodes: int = 35
    discount: float = 0.95
    step_size: float = 0.5
    max_kl: float = 0.01
    conjugate_steps: int = 10
    damping: float = 1e-5
    backtracks: int = 15
    backtrack_ratio: float = 0.8
    ridge: float = 1e-5


@dataclass(frozen=True, eq=False)
class World:
    """Environments of every model, made once: `episodes` of each."""

    envs: Sequence[Sequence[MDPEnv]]
    num_states: int
    num_actions: int
    horizon: int


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of N tasks, [N, B, T] flattened to [N, M]; `weight` is 1 up to an episode's end, else 0."""

    state: Tensor  # [N, M]
    action: Tensor  # [N, M]
    advantage: Tensor  # [N, M]
    weight: Tensor  # [N, M]
    count: int
    mean_return: float

    def mean(self, values: Tensor) -> Tensor:
        """[N], the mean over the steps that were taken."""
        return (values * self.weight).sum(dim=1) / self.weight.sum(dim=1)


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


def make_world(models: Sequence[TabularMDP], horizon: int, episodes: int) -> World:
    """An environment for every episode of an update, whichever tasks it draws."""
    envs = [[MDPEnv(model, horizon) for _ in range(episodes)] for model in models]
    acting = models[0].enabled[:, :-1]
    if not (acting.all(axis=1) | ~acting.any(axis=1)).all():
        raise InputError("the baseline masks no actions: each must be enabled wherever another one is")
    return World(envs, models[0].num_states, acting.shape[1], horizon)


def initial_policy(world: World, generator: torch.Generator) -> Parameters:
    """The network of merap's learner: one-hot state, 32, 32, A."""
    return initial_parameters(PolicyNetwork(world.num_states, world.num_actions), generator)


def baseline_update(
    world: World, theta: Parameters, settings: Settings, generator: torch.Generator
) -> tuple[Parameters, Times, float]:
    """One outer update of Algorithm 1.

    Returns:
        The new theta, the times, and the mean undiscounted return of the adapted policies.
    """
    times = Times()
    theta = {name: value.detach().requires_grad_() for name, value in theta.items()}
    drawn = torch.randperm(len(world.envs), generator=generator)[: settings.tasks].tolist()
    with times.part("sampling"):
        envs = SyncVectorEnv([partial(_as_is, env) for task in drawn for env in world.envs[task]], copy=False)
        meta = {name: value.detach().expand(len(drawn), *value.shape) for name, value in theta.items()}
        support = _sample(envs, meta, world, settings, generator)
    with times.part("inner step"):
        adapted = {name: value.detach() for name, value in _adapt(theta, support, settings).items()}
    with times.part("sampling"):
        query = _sample(envs, adapted, world, settings, generator)
    with times.part("outer step"):
        theta = _trust_region_step(theta, adapted, support, query, settings)
    times.steps = support.count + query.count
    return theta, times, query.mean_return


def _logits(parameters: Parameters, state: Tensor) -> Tensor:
    """[N, M, A] of parameters [N, ...] and states [N, M]; a one-hot state takes a row of the weight."""
    weight = parameters["layer0.weight"]
    num_tasks, num_states, _ = weight.shape
    row = state + torch.arange(num_tasks).unsqueeze(1) * num_states
    signal = embedding(row, weight.flatten(0, 1)) + _bias(parameters, 0)
    for layer in (1, 2):
        weight = parameters[f"layer{layer}.weight"]
        signal = torch.baddbmm(_bias(parameters, layer), torch.relu(signal), weight)
    return signal


def _bias(parameters: Parameters, layer: int) -> Tensor:
    return parameters[f"layer{layer}.bias"].unsqueeze(1)


@torch.no_grad()
def _sample(
    envs: SyncVectorEnv, policy: Parameters, world: World, settings: Settings, generator: torch.Generator
) -> Steps:
    """An episode in every environment, with its advantages."""
    num_tasks, num_envs = policy["layer0.bias"].shape[0], envs.num_envs
    shape = (num_envs, world.horizon)
    state, action = torch.zeros(shape, dtype=torch.int64), torch.zeros(shape, dtype=torch.int64)
    reward, weight = torch.zeros(shape), torch.zeros(shape)
    going = torch.ones(num_envs)
    seed = int(torch.randint(2**31, (), generator=generator))
    observed, _ = envs.reset(seed=seed)
    for t in range(world.horizon):
        state[:, t] = torch.from_numpy(observed)
        logits = _logits(policy, state[:, t].view(num_tasks, -1))
        probabilities = torch.softmax(logits.flatten(0, 1), dim=-1)
        action[:, t] = torch.multinomial(probabilities, 1, generator=generator).squeeze(1)
        observed, rewards, terminated, truncated, _ = envs.step(action[:, t].numpy())
        reward[:, t] = torch.from_numpy(rewards) * going
        weight[:, t] = going
        going = going * torch.from_numpy(~(terminated | truncated))
        if not going.any():
            break
    observation = one_hot(state, world.num_states).float()
    advantage = _advantages(observation, reward, weight, num_tasks, settings)
    return Steps(
        state=state.view(num_tasks, -1),
        action=action.view(num_tasks, -1),
        advantage=advantage,
        weight=weight.view(num_tasks, -1),
        count=int(weight.sum()),
        mean_return=reward.sum(dim=1).mean().item(),
    )


def _advantages(
    observation: Tensor, reward: Tensor, weight: Tensor, num_tasks: int, settings: Settings
) -> Tensor:
    """[N, M], return-to-go minus a ridge regression on observation, t, t^2, t^3, 1; normalised.

    In double precision: the ridge is too small for single.
    """
    horizon = reward.shape[1]
    to_go = torch.zeros_like(reward)
    ahead = torch.zeros(len(reward))
    for t in reversed(range(horizon)):
        ahead = reward[:, t] + settings.discount * ahead
        to_go[:, t] = ahead
    time_of = torch.arange(horizon) / 100
    of_time = torch.stack([time_of, time_of**2, time_of**3, torch.ones(horizon)], dim=-1)
    features = torch.cat([observation, of_time.expand(len(reward), -1, -1)], dim=-1)
    features = (features * weight.unsqueeze(-1)).view(num_tasks, -1, features.shape[-1]).double()  # [N, M, F]
    target, mask = to_go.view(num_tasks, -1, 1), weight.view(num_tasks, -1)
    matrix = features.mT @ features + settings.ridge * torch.eye(features.shape[-1])
    fitted = features @ torch.linalg.solve(matrix, features.mT @ target.double())
    advantage = (target - fitted.float()).squeeze(-1) * mask
    count = mask.sum(dim=1, keepdim=True)
    centred = (advantage - advantage.sum(dim=1, keepdim=True) / count) * mask
    deviation = (centred.square().sum(dim=1, keepdim=True) / count).sqrt()
    normalised: Tensor = centred / (deviation + 1e-8)
    return normalised


def _log_probs(parameters: Parameters, steps: Steps) -> tuple[Tensor, Tensor]:
    """Log-probabilities of all actions [N, M, A], and of those taken [N, M]."""
    every = torch.log_softmax(_logits(parameters, steps.state), dim=-1)
    return every, every.gather(-1, steps.action.unsqueeze(-1)).squeeze(-1)


def _adapt(theta: Parameters, support: Steps, settings: Settings) -> Parameters:
    """theta'_i [N, ...], differentiable in theta (`eq:adap`)."""
    num_tasks = len(support.action)
    copies = {name: value.expand(num_tasks, *value.shape) for name, value in theta.items()}
    _, taken = _log_probs(copies, support)
    loss = -support.mean(taken * support.advantage).sum()
    gradients = torch.autograd.grad(loss, list(copies.values()), create_graph=True)
    return {
        name: value - settings.step_size * gradient
        for (name, value), gradient in zip(copies.items(), gradients, strict=True)
    }


def _trust_region_step(
    theta: Parameters, adapted: Parameters, support: Steps, query: Steps, settings: Settings
) -> Parameters:
    """TRPO through the inner step (Schulman et al. 2015; `eq:meta-opt`)."""
    with torch.no_grad():
        old, old_taken = _log_probs(adapted, query)
    old_probs = old.exp()

    def surrogate(candidate: Parameters) -> tuple[Tensor, Tensor]:
        """The outer loss, and the KL divergence from the adapted policies that sampled."""
        every, taken = _log_probs(_adapt(candidate, support, settings), query)
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


def _as_is(env: MDPEnv) -> MDPEnv:
    return env


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
    world = make_world(base.models, base.horizon, settings.episodes)
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
