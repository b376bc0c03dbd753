"""A policy that is played as it is: `pretrained`, `joint`, `oracle`.

Axes: T steps, S states, A declared actions.
"""

from __future__ import annotations

import numpy as np

from merap.mdp.evaluation import as_policy
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.planning import backward_induction
from merap.strategies.drawing import draw_action
from merap.systems.interface import Observation
from merap.systems.strategy import StateIndex


def optimal_policy(model: TabularMDP, horizon: int) -> Floats:
    """float64 [T, S, A], the best time-indexed policy over the declared actions of a canonical model."""
    return as_policy(model, backward_induction(model, horizon).actions)[..., :-1]


class FixedStrategy:
    """Plays a policy and learns nothing; see `strategy.Strategy`.

    Args:
        policy: float64 [S, A] or [T, S, A]; later than T the last step's.
        valuations: int64 [S, V], the canonical index; the completed state is the last.
        generator: of its actions.
        reason: why this policy, for `explain`.
    """

    episodes_per_update = 1

    def __init__(self, policy: Floats, valuations: Ints, generator: np.random.Generator, reason: str) -> None:
        self._policy = policy
        self._by_time = policy if policy.ndim == 3 else policy[np.newaxis]
        self._number = StateIndex(valuations)
        self._generator = generator
        self._reason = reason
        self._state, self._time = -1, 0

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """An episode begins or goes on."""
        self._state, self._time = self._number(observation), time

    def act(self, allowed: Bools) -> int:
        """An action drawn from the policy, among those allowed."""
        now = min(self._time, len(self._by_time) - 1)
        return draw_action(self._by_time[now, self._state], allowed, self._generator.random())

    def observe(self, action: int, observation: Observation) -> None:
        """What a step has led to."""
        self._state, self._time = self._number(observation), self._time + 1

    def update(self) -> None:
        """Nothing changes."""

    def policy(self) -> Floats:
        """The policy."""
        return self._policy

    def explain(self) -> tuple[str, ...]:
        """Why this policy."""
        return (self._reason,)
