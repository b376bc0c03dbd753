"""The strategies `gradient` and `ope`: policy gradients from real episodes (`eq:adaptation`).

Both are one learner; `gradient` begins at the meta policy, `ope` (online policy evolution, the
paper's baseline) at random parameters.

Axes: B episodes, T steps, S states, A declared actions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from merap.learning.episodes import Episodes
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy
from merap.learning.policy import Parameters, initial_parameters, policy_table, stack_parameters
from merap.mdp.index import FamilyIndex
from merap.mdp.model import Bools, Floats
from merap.systems.interface import Observation
from merap.systems.strategy import StateIndex, draw_action

# Of every parameter, where no training has learned any (the authors' setting).
STEP_SIZE = 0.5
# The running mean of the advantages' variance looks back about that many updates.
VARIANCE_MEMORY = 20


@dataclass(frozen=True)
class _Step:
    time: int
    state: int
    action: int
    reward: float


def untrained(meta: MetaPolicy, generator: np.random.Generator) -> MetaPolicy:
    """Return a start for `ope`: network and rule of a meta policy, and nothing that it has learned."""
    drawn = torch.Generator().manual_seed(int(generator.integers(2**63)))
    parameters = initial_parameters(meta.network, drawn, meta.variance.dtype)
    step_sizes = {name: torch.full_like(value, STEP_SIZE) for name, value in parameters.items()}
    return replace(meta, parameters=parameters, step_sizes=step_sizes)


class GradientStrategy:
    """Adapts by policy gradients; see `strategy.Strategy`.

    Where an action is enabled is learned by looking: in a state that was never seen every action is
    taken to be. A step depends only on states that were, so it is the same as with the model known.

    Args:
        meta: where adaptation starts, and how far its steps go.
        index: S states.
        episodes_per_update: B.
        generator: draws its actions.
        trained: the start was learned, and its variance of the advantages with it; else that is a
            running mean over the updates.
    """

    def __init__(
        self,
        meta: MetaPolicy,
        index: FamilyIndex,
        episodes_per_update: int,
        generator: np.random.Generator,
        *,
        trained: bool = True,
    ) -> None:
        self.episodes_per_update = episodes_per_update
        self._meta = meta
        self._trained = trained
        self._variance = meta.variance if trained else None
        self._number = StateIndex(index)
        self._generator = generator
        self._parameters = stack_parameters(meta.parameters, 1)
        self._enabled = np.ones((index.num_states, meta.network.num_actions), dtype=np.bool_)
        self._enabled[index.is_completed] = False
        self._restriction = np.ones_like(self._enabled)
        self._episodes: list[list[_Step]] = []
        self._state, self._time = -1, 0
        self._last_returns: tuple[float, ...] = ()
        self._updates = 0
        self._behaviour = self._exploring()

    @property
    def parameters(self) -> Parameters:
        """Parameters of the policy after the steps so far."""
        return {name: value[0] for name, value in self._parameters.items()}

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """Begin an episode or go on with it; what a gap in it has earned counts as nothing."""
        if not resumed:
            self._episodes.append([])
        self._time = time
        self._look(observation)

    def restrict(self, mask: Bools) -> None:
        """Mask the logits: behaviour, gradient and policy keep to bool [S, A], where that leaves anything."""
        self._restriction = mask
        self._behaviour = self._exploring()

    def act(self, allowed: Bools) -> int:
        """Draw an allowed action from the policy with the rule's exploration."""
        return draw_action(self._behaviour[self._state], allowed, self._generator.random())

    def observe(self, action: int, observation: Observation) -> None:
        """Record a step."""
        self._episodes[-1].append(_Step(self._time, self._state, action, observation.reward))
        self._time += 1
        self._look(observation)

    def update(self) -> None:
        """Take one gradient step on the episodes since the last one."""
        meta = self._meta
        episodes = self._sampled()
        stepped = sampled_step(
            meta.network,
            self._parameters,
            meta.step_sizes,
            self._mask() | self._taken(),
            episodes,
            meta.rule,
            self._variance,
        )
        self._parameters = stepped.parameters
        self._last_returns = tuple(episodes.returns.flatten().tolist())
        self._updates += 1
        if not self._trained:
            self._variance = self._running_mean(stepped.variance.mean())
        self._episodes = []
        self._behaviour = self._exploring()

    def revise(self) -> None:
        """Drop the episodes since the last step."""
        self._episodes = []

    def policy(self) -> Floats:
        """Return float64 [S, A], the policy without exploration."""
        with torch.no_grad():
            return _rows(policy_table(self._meta.network, self._parameters, self._mask()))

    def explain(self) -> tuple[str, ...]:
        """Tell how far it has come."""
        start = "the meta policy" if self._trained else "random parameters"
        if not self._last_returns:
            return (f"{start} as before any episode",)
        mean, best = float(np.mean(self._last_returns)), max(self._last_returns)
        return (
            f"{self._updates} gradient steps from {start}",
            f"the last {len(self._last_returns)} episodes returned {mean:.3g} on average, {best:.3g} at best",
        )

    def _look(self, observation: Observation) -> None:
        self._state = self._number(observation)
        if observation.continuation and (self._enabled[self._state] != observation.enabled).any():
            self._enabled[self._state] = observation.enabled
            self._behaviour = self._exploring()

    def _mask(self) -> Tensor:
        """Return bool [1, S, A], where actions are taken to be enabled and are not masked."""
        left = self._enabled & self._restriction
        mask = np.where(left.any(axis=1, keepdims=True), left, self._enabled)
        return torch.from_numpy(mask).unsqueeze(0)

    def _taken(self) -> Tensor:
        """Return bool [1, S, A], the actions of the episodes: possible, though they may be masked by now."""
        taken = np.zeros_like(self._enabled)
        steps = [step for episode in self._episodes for step in episode]
        taken[[step.state for step in steps], [step.action for step in steps]] = True
        return torch.from_numpy(taken).unsqueeze(0)

    def _exploring(self) -> Floats:
        with torch.no_grad():
            return _rows(behaviour(self._meta.network, self._parameters, self._mask(), self._meta.rule))

    def _running_mean(self, seen: Tensor) -> Tensor:
        if self._variance is None:
            return seen
        return self._variance + (seen - self._variance) / min(self._updates, VARIANCE_MEMORY)

    def _sampled(self) -> Episodes:
        """Put the episodes side by side, every step at its time, padded to the longest."""
        steps = [step for episode in self._episodes for step in episode]
        number = np.repeat(np.arange(len(self._episodes)), [len(episode) for episode in self._episodes])
        time = np.array([step.time for step in steps])
        active = np.zeros((len(self._episodes), time.max() + 1), dtype=np.bool_)
        active[number, time] = True

        def padded(values: list[int] | list[float], dtype: torch.dtype) -> Tensor:
            table = torch.zeros(active.shape, dtype=dtype)
            table[number, time] = torch.tensor(values, dtype=dtype)
            return table.unsqueeze(0)

        return Episodes(
            state=padded([step.state for step in steps], torch.int64),
            action=padded([step.action for step in steps], torch.int64),
            reward=padded([step.reward for step in steps], self._meta.variance.dtype),
            active=torch.from_numpy(active).unsqueeze(0),
        )


def _rows(table: Tensor) -> Floats:
    """Return float64 [S, A] of [1, S, A]."""
    rows: Floats = table[0].double().numpy()
    return rows
