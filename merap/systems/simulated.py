"""Simulate a model as a managed system that draws its steps.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np

from merap.concerns.combination import DeclaredCombination, ResetMode
from merap.errors import InputError
from merap.mdp.model import Bools, TabularMDP
from merap.systems.detection import detections
from merap.systems.interface import Observation
from merap.systems.world import LocatedWorld, World, canonical_world, located_world

RESET_MODES: tuple[ResetMode, ...] = get_args(ResetMode)


class SimulatedSystem:
    """A model as a system that draws its steps.

    A combination is simulated by its definition, with the reward of each single step, and has a
    location even when its task is complete; slip, detectors and a lasting location need one.
    A task that begins after another one begins in the capability's initial mode; one that was truncated
    goes on in its mode.

    Args:
        model: on the canonical index of its case, or a combination.
        horizon: steps of an episode.
        generator: draws everything.
        slip: probability that an action does nothing, see `systems.slip`.
        noise: standard deviation of the Gaussian noise on rewards.
        detect: whether the case's detectors are read after every reset and step.
        reset: how the next episode begins; `return_to_start` travels there in the fewest expected steps,
            which are counted in `steps_back`, `none` begins where the last one ended.

    Raises:
        InputError: a number is out of range, there is no such reset mode, or a combination is needed.
        ModelError: the model can't be simulated.
    """

    def __init__(
        self,
        model: TabularMDP | DeclaredCombination,
        horizon: int,
        generator: np.random.Generator,
        *,
        slip: float = 0.0,
        noise: float = 0.0,
        detect: bool = False,
        reset: ResetMode = "episodes",
    ) -> None:
        if not 0 <= noise < math.inf:
            raise InputError(f"the noise on rewards must be 0 or more, it is {noise}")
        self._slip, self._noise, self._detect, self._reset = slip, noise, detect, reset_mode(reset)
        if isinstance(model, TabularMDP) and (slip or detect or self._reset != "episodes"):
            raise InputError("slip, detectors and a lasting location need a combination, not its model alone")
        self._world = self._made(model)
        self._horizon = horizon
        self._generator = generator
        self._state = -1
        self._steps = horizon
        self.steps_back = 0

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._world.simulator.action_names

    def reset(self) -> Observation:
        """Begin an episode.

        Raises:
            InputError: there is no way back to the start, or no task can begin where the system is.
        """
        self._state = self._first_state()
        self._steps = 0
        return self.look()

    def step(self, action: int) -> Observation:
        """Take an action."""
        simulator = self._world.simulator
        if self._steps >= self._horizon or simulator.completed[self._state]:
            raise InputError("the episode is over; reset the system first")
        if not 0 <= action < len(self.actions) or simulator.choice[self._state, action] < 0:
            state = self._world.model.describe_state(self._state)
            enabled = ", ".join(np.array(self.actions)[self.enabled])
            raise InputError(f"action {action} is not enabled in state {state}; enabled are {enabled}")
        choice = simulator.choice[self._state, action]
        branch = simulator.successors.draw(choice, self._generator.random())
        self._state = int(simulator.target[branch])
        self._steps += 1
        reward = float(simulator.reward[branch])
        if self._noise:
            reward += self._noise * float(self._generator.standard_normal())
        return self._observe(reward)

    def look(self) -> Observation:
        """Observe without a step; the detectors are read anew."""
        return self._observe(0.0)

    @property
    def state(self) -> int:
        """The number on the canonical index of the state that the system is in; -1 before it is reset."""
        return self._state if self._state < 0 else int(self._world.canonical[self._state])

    @property
    def standing(self) -> int:
        """Location and mode, p * Q + q, also where the task is complete; for a model alone as `state`."""
        return self._state // 2 if isinstance(self._world, LocatedWorld) else self.state

    @property
    def enabled(self) -> Bools:
        """bool [A], the actions that are possible now."""
        enabled: Bools = self._world.simulator.choice[self._state] >= 0
        return enabled

    def fits(self, model: TabularMDP | DeclaredCombination) -> bool:
        """Tell whether the system can go on under another model of its case, from where it is.

        Not in a location that is closed there, nor amid a task that is complete there.
        """
        if self._state < 0:
            return True
        if isinstance(model, TabularMDP):
            return bool(model.state_to_choice[self._state + 1] > model.state_to_choice[self._state])
        return self._located().allows(self._state, model)

    def switch(self, model: TabularMDP | DeclaredCombination) -> None:
        """Go on under another model of the same case, which `fits` or a reset follows.

        Raises:
            InputError: a combination can't follow a model alone, nor the other way round.
        """
        if isinstance(model, TabularMDP) == isinstance(self._world, LocatedWorld):
            raise InputError("a system made from a model goes on under a model, from a combination under one")
        self._world = self._made(model)

    def snapshot(self) -> dict[str, Any]:
        """Return all state that changes, as JSON has it."""
        return {
            "state": self._state,
            "steps": self._steps,
            "steps_back": self.steps_back,
            "generator": self._generator.bit_generator.state,
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from a snapshot, under the same model.

        Raises:
            InputError: it is none of such a system.
        """
        try:
            self._state, self._steps = int(snapshot["state"]), int(snapshot["steps"])
            self.steps_back = int(snapshot["steps_back"])
            self._generator.bit_generator.state = snapshot["generator"]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the recorded state of the system can't be used: {error}") from error

    def _first_state(self) -> int:
        first = int(self._world.simulator.first_states(0, self._generator.random()))
        if self._state < 0 or self._reset == "episodes":
            return first
        world = self._located()
        if self._reset == "return_to_start":
            start, _ = world.located(first)
            self.steps_back += world.return_trips.travel(self._state // 2, start, self._generator)
            return first
        return self._next_task(world)

    def _next_task(self, world: LocatedWorld) -> int:
        location, _ = world.located(self._state)
        completed = world.simulator.completed
        state = world.beginning(location) if completed[self._state] else self._state
        if completed[state] or not (world.simulator.choice[state] >= 0).any():
            name = world.combination.space.locations[location]
            raise InputError(f"no task can begin at {name}, where the last one ended: nothing is to be done")
        return state

    def _made(self, model: TabularMDP | DeclaredCombination) -> World:
        return canonical_world(model) if isinstance(model, TabularMDP) else located_world(model, self._slip)

    def _located(self) -> LocatedWorld:
        assert isinstance(self._world, LocatedWorld)
        return self._world

    def _observe(self, reward: float) -> Observation:
        world = self._world
        completed = bool(world.simulator.completed[self._state])
        seen: Mapping[str, object] = {}
        if self._detect and isinstance(world, LocatedWorld):
            seen = detections(world.combination, world.located(self._state)[0], self._generator)
        return Observation(
            valuation=world.valuations[self._state],
            enabled=self.enabled,
            reward=reward,
            continuation=0.0 if completed else 1.0,
            truncated=not completed and self._steps >= self._horizon,
            detections=seen,
        )


def reset_mode(name: str) -> ResetMode:
    """Return the reset mode of that name.

    Raises:
        InputError: there is none.
    """
    for mode in RESET_MODES:
        if mode == name:
            return mode
    raise InputError(f"there is no reset mode {name!r}; allowed: {', '.join(RESET_MODES)}")
