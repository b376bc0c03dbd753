"""The executor: carries out plans on the system.

Axes: A declared actions.
"""

from __future__ import annotations

import math

from merap.errors import InputError, MerapError
from merap.mapek.messages import Execution, Plan
from merap.systems.interface import ManagedSystem, Observation

# Number of faults in a row after which an episode is given up.
MAX_FAULTS = 3


class Executor:
    """Acts on the managed system; a fault of the system never gets any further than here.

    Args:
        system: under control.
    """

    def __init__(self, system: ManagedSystem) -> None:
        self._system = system
        self._faults = 0

    def reset(self) -> Execution:
        """Begin an episode."""
        self._faults = 0
        try:
            return Execution(None, self._checked(self._system.reset()))
        except MerapError as error:
            return Execution(None, None, str(error), over=True)

    def execute(self, plan: Plan) -> Execution:
        """Take the planned action; a wrapped or a remote system may have taken another one."""
        try:
            observation = self._checked(self._system.step(plan.action))
        except MerapError as error:
            self._faults += 1
            return Execution(plan.action, None, str(error), over=self._faults >= MAX_FAULTS)
        self._faults = 0
        return Execution(plan.action if observation.taken is None else observation.taken, observation)

    def _checked(self, observation: Observation) -> Observation:
        """Return the observation, if it can be used.

        Raises:
            InputError: the reward is not finite, `enabled` has another shape than [A], or no action is
                enabled though the episode goes on.
        """
        count = len(self._system.actions)
        if not math.isfinite(observation.reward):
            raise InputError(f"the system reports the reward {observation.reward}, expected a finite number")
        if observation.enabled.shape != (count,):
            said = observation.enabled.size
            raise InputError(f"the system says of {said} actions whether they are enabled, not of {count}")
        if not observation.last and not observation.enabled.any():
            raise InputError("the system has no action that is enabled, though the episode goes on")
        return observation
