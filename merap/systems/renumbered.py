"""Show the actions and variables of a managed system in the order of its manager.

Axes: A actions, V state variables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from merap.errors import InputError, listed
from merap.systems.interface import ManagedSystem, Observation

MAX_LISTED = 20


class RenumberedSystem:
    """Numbers actions and variables as its manager does.

    Args:
        system: the managed system.
        shown: names of its variables, in the order of its valuations.
        actions: A names, in the order of the manager.
        variables: V names, in the order of the manager.
        constants: variables among these that the system need not have -> their only value.

    Raises:
        InputError: the system has other actions or variables.
    """

    def __init__(
        self,
        system: ManagedSystem,
        shown: Sequence[str],
        *,
        actions: Sequence[str],
        variables: Sequence[str],
        constants: Mapping[str, int],
    ) -> None:
        known = [name for name in variables if name not in constants or name in shown]
        for kind, wanted, found in (("actions", actions, system.actions), ("variables", known, shown)):
            if sorted(wanted) != sorted(found):
                raise InputError(
                    f"it has the {kind} {listed(found, MAX_LISTED)}; expected {listed(wanted, MAX_LISTED)}"
                )
        self._system = system
        self._actions = tuple(actions)
        self._theirs = np.array([system.actions.index(name) for name in actions])
        missing = [name for name in variables if name not in shown]
        self._missing = [constants[name] for name in missing]
        self._columns = np.array([[*shown, *missing].index(name) for name in variables])

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._actions

    def reset(self) -> Observation:
        """Begin an episode."""
        return self._renumbered(self._system.reset())

    def step(self, action: int) -> Observation:
        """Take an action."""
        if not 0 <= action < len(self._actions):
            raise InputError(f"there is no action {action}, only 0 to {len(self._actions) - 1}")
        return self._renumbered(self._system.step(int(self._theirs[action])))

    def _renumbered(self, observation: Observation) -> Observation:
        values = np.concatenate([observation.valuation, np.array(self._missing, dtype=np.int64)])
        taken = observation.taken
        return replace(
            observation,
            valuation=values[self._columns],
            enabled=observation.enabled[self._theirs],
            taken=None if taken is None else int(np.flatnonzero(self._theirs == taken)[0]),
        )
