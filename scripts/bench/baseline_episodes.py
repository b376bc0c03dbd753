"""Episodes on SyncVectorEnv, for the baseline that merap's learner is timed against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from gymnasium.vector import SyncVectorEnv
from torch import Tensor
from torch.nn.functional import embedding, one_hot

from merap.errors import InputError
from merap.learning.policy import Parameters, PolicyNetwork, initial_parameters
from merap.mdp.gymnasium_env import MDPEnv
from merap.mdp.model import TabularMDP


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
        """Return [N], the mean over the steps that were taken."""
        return (values * self.weight).sum(dim=1) / self.weight.sum(dim=1)


def make_world(models: Sequence[TabularMDP], horizons: Sequence[int], episodes: int) -> World:
    """Make an environment for every episode of an update, whichever tasks it draws.

    Raises:
        InputError: the tasks differ in their horizons, or an action is disabled where another is enabled.
    """
    if len(set(horizons)) > 1:
        raise InputError(f"the baseline knows one horizon, and the tasks have {sorted(set(horizons))}")
    horizon = horizons[0]
    envs = [[MDPEnv(model, horizon) for _ in range(episodes)] for model in models]
    acting = models[0].enabled[:, :-1]
    if not (acting.all(axis=1) | ~acting.any(axis=1)).all():
        raise InputError("the baseline masks no actions: each must be enabled wherever another one is")
    return World(envs, models[0].num_states, acting.shape[1], horizon)


def initial_policy(world: World, generator: torch.Generator) -> Parameters:
    """Make the network of merap's learner: one-hot state, 32, 32, A."""
    return initial_parameters(PolicyNetwork(world.num_states, world.num_actions), generator)


def _logits(parameters: Parameters, state: Tensor) -> Tensor:
    """Return [N, M, A] of parameters [N, ...] and states [N, M]; a one-hot state takes one row of weights."""
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
def sample(
    envs: SyncVectorEnv, policy: Parameters, world: World, settings: Settings, generator: torch.Generator
) -> Steps:
    """Sample an episode in every environment, with its advantages."""
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
    advantage = advantages(observation, reward, weight, num_tasks, settings)
    return Steps(
        state=state.view(num_tasks, -1),
        action=action.view(num_tasks, -1),
        advantage=advantage,
        weight=weight.view(num_tasks, -1),
        count=int(weight.sum()),
        mean_return=reward.sum(dim=1).mean().item(),
    )


def advantages(
    observation: Tensor, reward: Tensor, weight: Tensor, num_tasks: int, settings: Settings
) -> Tensor:
    """Return [N, M], return-to-go minus a ridge regression on observation, t, t^2, t^3, 1; normalised.

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


def log_probs(parameters: Parameters, steps: Steps) -> tuple[Tensor, Tensor]:
    """Return log-probabilities of all actions [N, M, A], and of those taken [N, M]."""
    every = torch.log_softmax(_logits(parameters, steps.state), dim=-1)
    return every, every.gather(-1, steps.action.unsqueeze(-1)).squeeze(-1)


def same_environment(env: MDPEnv) -> MDPEnv:
    return env
