"""Systems that are met online: seen through `reset` and `step` alone.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from merap.errors import InputError
from merap.mdp.model import Bools, Ints, TabularMDP
from merap.mdp.simulation import simulator


@dataclass(frozen=True, eq=False)
class Observation:
    """What a managed system lets its manager see after a reset or a step.

    Attributes:
        valuation: int64 [V], values of the state variables.
        enabled: bool [A], the actions that are possible now.
        reward: earned by the last step; 0 after a reset.
        continuation: 0 once the task is complete, else 1 (dm_env's discount).
        truncated: the horizon is reached though the task is not complete.
        detections: name of a detector -> what it reads.
    """

    valuation: Ints
    enabled: Bools
    reward: float
    continuation: float
    truncated: bool
    detections: Mapping[str, object] = field(default_factory=dict)

    @property
    def last(self) -> bool:
        """Whether the episode is over."""
        return self.truncated or self.continuation == 0


class ManagedSystem(Protocol):
    """A system under control."""

    @property
    def actions(self) -> tuple[str, ...]:
        """A names; `step` takes an index into them."""

    def reset(self) -> Observation:
        """Begin an episode."""

    def step(self, action: int) -> Observation:
        """Take an action.

        Raises:
            InputError: the action is not enabled, or the episode is over.
        """


class SimulatedSystem:
    """A canonical model as a system that draws its steps.

    Args:
        model: on the canonical index of its case.
        horizon: steps of an episode.
        generator: of every draw.
    """

    def __init__(self, model: TabularMDP, horizon: int, generator: np.random.Generator) -> None:
        self._model = model
        self._simulator = simulator([model])
        self._horizon = horizon
        self._generator = generator
        self._state = -1
        self._steps = horizon

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._simulator.action_names

    def reset(self) -> Observation:
        """Begin an episode."""
        self._state = int(self._simulator.first_states(0, self._generator.random()))
        self._steps = 0
        return self._observe(0.0)

    def step(self, action: int) -> Observation:
        """Take an action."""
        if self._steps >= self._horizon or self._simulator.completed[self._state]:
            raise InputError("the episode is over; reset the system first")
        if not 0 <= action < len(self.actions) or self._simulator.choice[self._state, action] < 0:
            state = self._model.describe_state(self._state)
            enabled = ", ".join(np.array(self.actions)[self.enabled])
            raise InputError(f"action {action} is not enabled in state {state}; enabled are {enabled}")
        choice = self._simulator.choice[self._state, action]
        branch = self._simulator.successors.draw(choice, self._generator.random())
        self._state = int(self._simulator.target[branch])
        self._steps += 1
        return self._observe(float(self._simulator.reward[branch]))

    @property
    def state(self) -> int:
        """The number of the state that the system is in; -1 before it is reset."""
        return self._state

    @property
    def enabled(self) -> Bools:
        """bool [A], the actions that are possible now."""
        enabled: Bools = self._simulator.choice[self._state] >= 0
        return enabled

    def fits(self, model: TabularMDP) -> bool:
        """Whether the system can go on under another model of its case, from where it is."""
        return self._state < 0 or bool(
            model.state_to_choice[self._state + 1] > model.state_to_choice[self._state]
        )

    def switch(self, model: TabularMDP) -> None:
        """Go on under another model of the same case, which `fits` or a reset follows."""
        self._model = model
        self._simulator = simulator([model])

    def snapshot(self) -> dict[str, Any]:
        """All that changes, as JSON has it."""
        return {
            "state": self._state,
            "steps": self._steps,
            "generator": self._generator.bit_generator.state,
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from a snapshot, under the same model.

        Raises:
            InputError: it is none of such a system.
        """
        try:
            self._state, self._steps = int(snapshot["state"]), int(snapshot["steps"])
            self._generator.bit_generator.state = snapshot["generator"]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the recorded state of the system can't be used: {error}") from error

    def _observe(self, reward: float) -> Observation:
        completed = bool(self._simulator.completed[self._state])
        return Observation(
            valuation=self._model.valuations[self._state],
            enabled=self.enabled,
            reward=reward,
            continuation=0.0 if completed else 1.0,
            truncated=not completed and self._steps >= self._horizon,
        )
