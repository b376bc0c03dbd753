"""The strategy `gradient`: gradient steps from the meta policy on real episodes (`eq:adaptation`).

Axes: B episodes, T steps, S states, A declared actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy
from merap.learning.policy import policy_table, stack_parameters
from merap.learning.rollout import Episodes
from merap.mdp.model import Bools, Floats, Ints
from merap.online.strategy import StateIndex
from merap.online.systems import Observation


@dataclass(frozen=True)
class _Step:
    state: int
    action: int
    reward: float


class GradientStrategy:
    """Adapts by policy gradients; see `strategy.Strategy`.

    Where an action is enabled is learned by looking: in a state that was never seen every action is
    taken to be. A step depends only on states that were, so it is the same as with the model known.

    Args:
        meta: where adaptation starts, and how far its steps go.
        valuations: int64 [S, V], the canonical index; the completed state is the last.
        episodes_per_update: B.
        generator: of its actions.
    """

    def __init__(
        self, meta: MetaPolicy, valuations: Ints, episodes_per_update: int, generator: np.random.Generator
    ) -> None:
        self.episodes_per_update = episodes_per_update
        self._meta = meta
        self._number = StateIndex(valuations)
        self._generator = generator
        self._parameters = stack_parameters(meta.parameters, 1)
        enabled = torch.ones(1, len(valuations), meta.network.num_actions, dtype=torch.bool)
        enabled[:, -1] = False
        self._enabled = enabled
        self._episodes: list[list[_Step]] = []
        self._state = -1
        self._last_returns: tuple[float, ...] = ()
        self._updates = 0
        self._behaviour = self._exploring()

    def begin(self, observation: Observation) -> None:
        """An episode begins."""
        self._episodes.append([])
        self._look(observation)

    def act(self, allowed: Bools) -> int:
        """An action drawn from the policy with the rule's exploration, among those allowed."""
        shares = self._behaviour[self._state] * allowed
        if shares.sum() == 0:
            shares = allowed.astype(np.float64)
        return int(self._generator.choice(len(shares), p=shares / shares.sum()))

    def observe(self, action: int, observation: Observation) -> None:
        """What a step has led to."""
        self._episodes[-1].append(_Step(self._state, action, observation.reward))
        self._look(observation)

    def update(self) -> None:
        """One gradient step on the episodes since the last one."""
        meta = self._meta
        episodes = self._sampled()
        self._parameters = sampled_step(
            meta.network,
            self._parameters,
            meta.step_sizes,
            self._enabled,
            episodes,
            meta.rule,
            meta.variance,
        ).parameters
        self._last_returns = tuple(episodes.returns.flatten().tolist())
        self._updates += 1
        self._episodes = []
        self._behaviour = self._exploring()

    def policy(self) -> Floats:
        """float64 [S, A], the policy without exploration."""
        with torch.no_grad():
            return _rows(policy_table(self._meta.network, self._parameters, self._enabled))

    def explain(self) -> tuple[str, ...]:
        """How far it has come."""
        if not self._last_returns:
            return ("the meta policy as it was trained; no episode yet",)
        mean, best = float(np.mean(self._last_returns)), max(self._last_returns)
        return (
            f"{self._updates} gradient steps from the meta policy",
            f"the last {len(self._last_returns)} episodes returned {mean:.3g} on average, {best:.3g} at best",
        )

    def _look(self, observation: Observation) -> None:
        self._state = self._number(observation)
        seen = torch.from_numpy(observation.enabled)
        if observation.continuation and not torch.equal(self._enabled[0, self._state], seen):
            self._enabled[0, self._state] = seen
            self._behaviour = self._exploring()

    def _exploring(self) -> Floats:
        with torch.no_grad():
            return _rows(behaviour(self._meta.network, self._parameters, self._enabled, self._meta.rule))

    def _sampled(self) -> Episodes:
        """The episodes side by side, padded to the longest."""
        shape = (1, len(self._episodes), max(map(len, self._episodes)))
        state, action = torch.zeros(shape, dtype=torch.int64), torch.zeros(shape, dtype=torch.int64)
        reward = torch.zeros(shape, dtype=self._meta.variance.dtype)
        active = torch.zeros(shape, dtype=torch.bool)
        for number, steps in enumerate(self._episodes):
            state[0, number, : len(steps)] = torch.tensor([step.state for step in steps])
            action[0, number, : len(steps)] = torch.tensor([step.action for step in steps])
            reward[0, number, : len(steps)] = torch.tensor([step.reward for step in steps])
            active[0, number, : len(steps)] = True
        return Episodes(state, action, reward, active)


def _rows(table: Tensor) -> Floats:
    """float64 [S, A] of [1, S, A]."""
    rows: Floats = table[0].double().numpy()
    return rows
