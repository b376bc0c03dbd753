"""A policy that is played as it is: `pretrained`, `joint`, `oracle`.

Axes: T steps, S states, A declared actions.
"""

from __future__ import annotations

import numpy as np

from merap.mdp.evaluation import as_policy
from merap.mdp.index import FamilyIndex
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.mdp.planning import backward_induction
from merap.systems.interface import Observation
from merap.systems.strategy import StateIndex, draw_action


def optimal_policy(model: TabularMDP, horizon: int) -> Floats:
    """Return float64 [T, S, A], the best time-indexed policy of a model on an index, without `end`."""
    return as_policy(model, backward_induction(model, horizon).actions)[..., :-1]


class FixedStrategy:
    """Plays a policy and learns nothing; see `systems.strategy.Strategy`.

    Args:
        policy: float64 [S, A] or [T, S, A]; after T steps the last one holds.
        index: S states.
        generator: draws its actions.
        reason: why this policy, for `explain`.
    """

    episodes_per_update = 1

    def __init__(
        self, policy: Floats, index: FamilyIndex, generator: np.random.Generator, reason: str
    ) -> None:
        self._policy = policy
        self._by_time = policy if policy.ndim == 3 else policy[np.newaxis]
        self._number = StateIndex(index)
        self._generator = generator
        self._reason = reason
        self._state, self._time = -1, 0

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """Begin an episode, or go on with it."""
        self._state, self._time = self._number(observation), time

    def act(self, allowed: Bools) -> int:
        """Draw an allowed action from the policy."""
        now = min(self._time, len(self._by_time) - 1)
        return draw_action(self._by_time[now, self._state], allowed, self._generator.random())

    def observe(self, action: int, observation: Observation) -> None:
        """Follow a step."""
        self._state, self._time = self._number(observation), self._time + 1

    def update(self) -> None:
        """Change nothing."""

    def policy(self) -> Floats:
        """Return the policy."""
        return self._policy

    def explain(self) -> tuple[str, ...]:
        """Return the reason for this policy."""
        return (self._reason,)
