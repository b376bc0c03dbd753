"""The states and steps of a simulated system: of a model, or of a program by its definition.

Axes: S states, V state variables, U variables of the whole state: the V that are seen and, where there is
one, the flag that an action has completed the task.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Protocol, TypeAlias

import numpy as np

from merap.errors import ModelError
from merap.mdp.alignment import align_actions
from merap.mdp.model import Ints, TabularMDP
from merap.mdp.simulation import Simulator, simulator
from merap.program.arrays import tabular
from merap.program.exploration import explore, started_at
from merap.program.form import Program

# Worlds that are kept of those that begin in a state that the first one lacks.
KEPT = 64
# Name of a variable -> its value in a whole state.
Values: TypeAlias = Mapping[str, int]


@dataclass(frozen=True, eq=False)
class World:
    """A model whose steps can be drawn.

    Attributes:
        model: whose states are those of the simulation, valuations [S, U].
        simulator: of the model.
        shown: int64 [S, V], the values that are seen in each state.
    """

    model: TabularMDP
    simulator: Simulator
    shown: Ints

    def number(self, values: Values) -> int | None:
        """Return the number of a state; None: it is not among the states."""
        wanted = [values[name] for name in self.model.variable_names]
        found = np.flatnonzero((self.model.valuations == wanted).all(axis=1))
        return int(found[0]) if len(found) else None

    def values(self, state: int) -> Values:
        """Return the values of all variables in a state."""
        return dict(zip(self.model.variable_names, self.model.valuations[state].tolist(), strict=True))


class Worlds(Protocol):
    """The worlds in which a system can be: they differ in the states that they hold."""

    @property
    def started(self) -> World:
        """All states that are reachable from where an episode begins."""

    def holding(self, values: Values) -> World:
        """Return a world with a state, and all states that are reachable from there.

        Raises:
            MerapError: there is no such world.
        """


class ModelWorlds:
    """A model as it is.

    Args:
        model: the model.

    Raises:
        ModelError: see `simulator`.
    """

    def __init__(self, model: TabularMDP) -> None:
        self.started = World(model, simulator([model]), model.valuations)

    def holding(self, values: Values) -> World:
        """Return the model's only world; see `Worlds`."""
        if self.started.number(values) is None:
            raise ModelError(f"the model has no state {dict(values)}")
        return self.started


class ProgramWorlds:
    """A program by its definition, explored from wherever the system is.

    Args:
        program: closed.
        action_names: in the order in which actions are numbered.
        reward: the reward structure, of each single step; None: no rewards.
        shown: names of the variables that are seen, in their order; None: all.
    """

    def __init__(
        self,
        program: Program,
        action_names: Sequence[str],
        *,
        reward: str | None = None,
        shown: Sequence[str] | None = None,
    ) -> None:
        self._program = program
        self._reward = reward
        self._action_names = tuple(action_names)
        self._shown = [one.name for one in program.variables] if shown is None else shown
        self._elsewhere = lru_cache(maxsize=KEPT)(self._explored_from)

    @cached_property
    def started(self) -> World:
        """See `Worlds`.

        Raises:
            ModelError: nothing is possible in a state, or a task begins completed.
        """
        return self._explored(self._program)

    def holding(self, values: Values) -> World:
        """See `Worlds`.

        Raises:
            ModelError: nothing is possible in a state, or the state is completed.
            InputError: the program has no such state.
        """
        if self.started.number(values) is not None:
            return self.started
        return self._elsewhere(tuple(values[one.name] for one in self._program.variables))

    def _explored_from(self, state: tuple[int, ...]) -> World:
        names = (one.name for one in self._program.variables)
        return self._explored(started_at(self._program, dict(zip(names, state, strict=True))))

    def _explored(self, program: Program) -> World:
        found = tabular(program, explore(program), reward=self._reward)
        number = align_actions(found, self._action_names)
        model = replace(found, action_names=self._action_names, choice_action=number[found.choice_action])
        shown = model.valuations[:, [model.variable_names.index(name) for name in self._shown]]
        shown.flags.writeable = False
        return World(model, simulator([model]), shown)
