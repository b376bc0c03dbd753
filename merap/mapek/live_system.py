"""A system that is not simulated: nobody knows its true model, and no state of it can be restored."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from merap.errors import InputError, MerapError
from merap.mapek.instrumented import Tally
from merap.mapek.scenario import Stage
from merap.mdp.model import TabularMDP
from merap.systems.interface import ManagedSystem, Observation, SystemFault
from merap.systems.retrying import Retries, RetryingSystem


class Disconnected:
    """Stands for a system that is not connected, where records alone are repeated.

    Args:
        actions: A names.
    """

    def __init__(self, actions: tuple[str, ...]) -> None:
        self.actions = actions

    def reset(self) -> Observation:
        """Begin an episode.

        Raises:
            MerapError: always.
        """
        raise MerapError("the system is not connected")

    def step(self, action: int) -> Observation:
        """Take an action.

        Raises:
            MerapError: always.
        """
        raise MerapError(f"the system is not connected; action {action} can't be taken")


class LiveSystem:
    """Repeats calls that have failed, and keeps count; see `instrumented.InstrumentedSystem`.

    Args:
        system: the system itself.
        horizon: steps of an episode.
        discount: discount of each step, for the report.
        retries: retries of a call that fails.
    """

    stages: tuple[Stage, ...] = ()
    models: tuple[TabularMDP, ...] = ()
    stage = 0
    truth = None

    def __init__(self, system: ManagedSystem, horizon: int, discount: float, retries: Retries) -> None:
        self.horizon = horizon
        self._system = RetryingSystem(system, retries=retries, on_fault=self._count_fault)
        self._discount = discount
        self.begin(0)

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._system.actions

    @property
    def tally(self) -> Tally:
        """Counts of the episode."""
        return Tally(self._steps, self._earned, self._discounted, None, self._completed, dict(self._faults))

    def begin(self, episode: int) -> None:
        """Begin the episode with this number."""
        self._steps = 0
        self._earned = self._discounted = 0.0
        self._completed = False
        self._faults: Counter[str] = Counter()

    def reset(self) -> Observation:
        """Begin an episode.

        Raises:
            SystemFault: the system can't be reached or does not behave.
        """
        return self._system.reset()

    def step(self, action: int) -> Observation:
        """Take an action.

        Raises:
            SystemFault: the system can't be reached or does not behave.
        """
        observation = self._system.step(action)
        self._earned += observation.reward
        self._discounted += self._discount**self._steps * observation.reward
        self._steps += 1
        self._completed = observation.continuation == 0
        return observation

    def snapshot(self) -> None:
        """Return nothing: the system is somewhere else, and goes on by itself."""

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Refuse: a recorded state is one of a simulation.

        Raises:
            InputError: always.
        """
        raise InputError("the recorded state is one of a simulated system")

    def _count_fault(self, fault: SystemFault) -> None:
        self._faults[fault.kind] += 1
