"""Simulate a model as a managed system that draws its steps.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, get_args

import numpy as np

from merap.concerns.combination import Combination, DeclaredCombination, ResetMode
from merap.errors import InputError, MerapError
from merap.mdp.model import Bools, TabularMDP
from merap.mdp.reserved_names import MODE_VARIABLE, UNSAFE_LABEL
from merap.systems.description import shown_variables
from merap.systems.detection import detections
from merap.systems.interface import Observation
from merap.systems.places import leaves_open, location_in, spatial
from merap.systems.return_policy import ReturnTrips
from merap.systems.slip import slipping
from merap.systems.world import KEPT, ModelWorlds, ProgramWorlds, Values, World, Worlds

RESET_MODES: tuple[ResetMode, ...] = get_args(ResetMode)


class SimulatedSystem:
    """A model as a system that draws its steps.

    A combination is simulated by its definition, with the reward of each single step. All its variables are
    seen but the flag that an action has completed the task, also where the task is complete. Slip, detectors
    and what lasts from one episode to the next need a combination.

    Args:
        model: on the index of its case, or a combination.
        horizon: steps of an episode.
        generator: draws everything.
        slip: probability that an action does nothing, see `systems.slip`.
        noise: standard deviation of the Gaussian noise on rewards.
        detect: whether the case's detectors, if it has any, are read after every reset and step.
        reset: how the next episode begins. `episodes`: as the first. `return_to_start`: likewise, after the
            system has travelled to the start in the fewest expected steps, which are counted in
            `steps_back`. `none`: a truncated task goes on where it is; one that is complete is followed by
            another, before which only monitors and the capability's mode begin anew.

    Raises:
        InputError: a number is out of range, there is no such reset mode, a combination or a space is
            needed.
        ModelError: the model can't be simulated.
    """

    def __init__(
        self,
        model: TabularMDP | Combination,
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
        if isinstance(model, TabularMDP):
            if slip or detect or reset != "episodes":
                raise InputError("slip, detectors and lasting states need a combination, not its model alone")
        elif reset == "return_to_start" and spatial(model) is None:
            raise InputError(
                f"{model.name} has no space in which to return to a start; reset it by `none` or `episodes`"
            )
        self._worlds_of = lru_cache(maxsize=KEPT)(self._made)
        self._trips_of = lru_cache(maxsize=KEPT)(self._planned)
        self._model = model
        self._world = self._worlds_of(model).started
        self._horizon = horizon
        self._generator = generator
        self._state: int | None = None
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
        self._world, self._state = self._first()
        self._steps = 0
        return self.look()

    def step(self, action: int) -> Observation:
        """Take an action."""
        simulator, state = self._world.simulator, self._state
        if state is None or self._steps >= self._horizon or simulator.completed[state]:
            raise InputError("the episode is over; reset the system first")
        if not 0 <= action < len(self.actions) or simulator.choice[state, action] < 0:
            enabled = ", ".join(np.array(self.actions)[self.enabled])
            raise InputError(
                f"action {action} is not enabled in state {self._world.model.describe_state(state)}; "
                f"enabled are {enabled}"
            )
        branch = simulator.successors.draw(simulator.choice[state, action], self._generator.random())
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
    def values(self) -> Values | None:
        """The values of all variables, the flag included; None before the first reset."""
        return None if self._state is None else self._world.values(self._state)

    @property
    def unsafe(self) -> bool:
        """Whether the state is labelled `unsafe`."""
        labels = self._world.model.labels
        return self._state is not None and UNSAFE_LABEL in labels and bool(labels[UNSAFE_LABEL][self._state])

    @property
    def enabled(self) -> Bools:
        """bool [A], the actions that are possible now."""
        enabled: Bools = self._world.simulator.choice[self._there()] >= 0
        return enabled

    def fits(self, model: TabularMDP | Combination) -> bool:
        """Tell whether the system can go on under another model of its case, from where it is.

        Not in a location that is closed there, in a state that is not there, or amid a task that is complete
        there.
        """
        if self._state is None:
            return True
        values = self._world.values(self._state)
        if not isinstance(model, TabularMDP) and not leaves_open(model, values):
            return False
        return self._over(self._state) or self._going_on(model, values) is not None

    def switch(self, model: TabularMDP | Combination) -> None:
        """Go on under another model of the same case, which `fits` or a reset follows.

        Raises:
            InputError: a combination can't follow a model alone, nor the other way round.
        """
        if isinstance(model, TabularMDP) != isinstance(self._model, TabularMDP):
            raise InputError("a system made from a model goes on under a model, from a combination under one")
        self._model = model
        if self._state is not None and not self._over(self._state):
            there = self._going_on(model, self._world.values(self._state))
            if there is not None:
                self._world, self._state = there

    def snapshot(self) -> dict[str, Any]:
        """Return all state that changes, as JSON has it."""
        return {
            "values": None if self._state is None else self._world.values(self._state),
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
            values = snapshot["values"]
            if values is not None:
                self._world = self._worlds_of(self._model).holding(values)
            self._state = None if values is None else self._world.number(values)
            self._steps, self.steps_back = int(snapshot["steps"]), int(snapshot["steps_back"])
            self._generator.bit_generator.state = snapshot["generator"]
        except (KeyError, TypeError, ValueError, MerapError) as error:
            raise InputError(f"the recorded state of the system can't be used: {error}") from error

    def _first(self) -> tuple[World, int]:
        """Return where the next episode begins."""
        worlds = self._worlds_of(self._model)
        first = int(worlds.started.simulator.first_states(0, self._generator.random()))
        if self._state is None or self._reset == "episodes":
            return worlds.started, first
        begun, here = worlds.started.values(first), self._world.values(self._state)
        if self._reset == "return_to_start":
            self.steps_back += self._trips_of(self._model).travel(here, begun, self._generator)
            return worlds.started, first
        if not self._over(self._state):
            return self._world, self._state
        anew = _begun_anew(self._model)
        return self._next_task({name: begun[name] if name in anew else here[name] for name in here})

    def _next_task(self, values: Values) -> tuple[World, int]:
        there = self._going_on(self._model, values)
        if there is None:
            state = self._world.model.describe_state(self._there())
            raise InputError(f"no task can begin in state {state}, where the last one ended")
        return there

    def _going_on(self, model: TabularMDP | Combination, values: Values) -> tuple[World, int] | None:
        """Return where a system goes on under a model; None: there is no such state, or nothing to do."""
        try:
            world = self._worlds_of(model).holding(values)
        except MerapError:
            return None
        state = world.number(values)
        assert state is not None
        return (world, state) if (world.simulator.choice[state] >= 0).any() else None

    def _over(self, state: int) -> bool:
        return bool(self._world.simulator.completed[state])

    def _there(self) -> int:
        if self._state is None:
            raise InputError("the episode has not begun; reset the system first")
        return self._state

    def _made(self, model: TabularMDP | Combination) -> Worlds:
        if isinstance(model, TabularMDP):
            return ModelWorlds(model)
        return true_worlds(model, self._slip)

    def _planned(self, model: Combination) -> ReturnTrips:
        located = spatial(model)
        assert located is not None
        return ReturnTrips(located, slipping(located.program, self._slip))

    def _observe(self, reward: float) -> Observation:
        state = self._there()
        completed = self._over(state)
        seen: Mapping[str, object] = {}
        located = None if isinstance(self._model, TabularMDP) else spatial(self._model)
        if self._detect and located is not None:
            location = location_in(located, self._world.values(state))
            seen = detections(located, location, self._generator)
        return Observation(
            valuation=self._world.shown[state],
            enabled=self.enabled,
            reward=reward,
            continuation=0.0 if completed else 1.0,
            truncated=not completed and self._steps >= self._horizon,
            detections=seen,
        )


def true_worlds(combination: Combination, slip: float) -> ProgramWorlds:
    """Return the states and steps of a combination, with the reward of each single step.

    Raises:
        InputError: see `slipping`.
    """
    return ProgramWorlds(
        slipping(combination.program, slip),
        combination.action_names,
        reward="objective",
        shown=[variable.name for variable in shown_variables(combination.program)],
    )


def _begun_anew(model: TabularMDP | Combination) -> frozenset[str]:
    """Return the variables that do not last when a task has ended and another one begins."""
    if isinstance(model, TabularMDP):
        return frozenset(model.variable_names)
    mode = {MODE_VARIABLE} if isinstance(model, DeclaredCombination) else set()
    return model.program.monitors | mode


def reset_mode(name: str) -> ResetMode:
    """Return the reset mode of that name.

    Raises:
        InputError: there is none.
    """
    for mode in RESET_MODES:
        if mode == name:
            return mode
    raise InputError(f"there is no reset mode {name!r}; allowed: {', '.join(RESET_MODES)}")
