"""The executor: does to the system what is planned, within what the shield allows.

Axes: S states of the canonical index (the completed state is the last), A declared actions.
"""

from __future__ import annotations

import math

from merap.errors import InputError, MerapError
from merap.mapek.loop_shield import LoopShield
from merap.mapek.messages import Execution, Monitored, Plan
from merap.mdp.model import Bools, Floats
from merap.systems.interface import ManagedSystem, Observation

# An episode is given up after so many faults in a row.
MAX_FAULTS = 3


class Executor:
    """Acts on the managed system; a fault of it never gets any further than here.

    Args:
        system: under control.
        shield: what is safe enough; None: everything.
    """

    def __init__(self, system: ManagedSystem, shield: LoopShield | None) -> None:
        self._system = system
        self._shield = shield
        self._faults = 0

    def reset(self) -> Execution:
        """Begin an episode."""
        self._faults = 0
        if self._shield is not None:
            self._shield.begin()
        try:
            return Execution(None, self._sound(self._system.reset()))
        except MerapError as error:
            return Execution(None, None, str(error), over=True)

    def observe(self, monitored: Monitored) -> None:
        """What has arrived counts for what is safe."""
        if self._shield is not None:
            self._shield.observe(monitored)

    def forget(self, monitored: Monitored) -> None:
        """The domain has changed; this has arrived last."""
        if self._shield is not None:
            self._shield.forget(monitored)

    def allowed(self, monitored: Monitored) -> Bools:
        """bool [A], what may be done now, never empty."""
        if self._shield is None:
            return monitored.enabled
        return self._shield.allowed(monitored)

    def mask(self) -> Bools | None:
        """bool [S, A], what may ever be done; None: everything."""
        return None if self._shield is None else self._shield.mask

    def carried_out(self, table: Floats) -> Floats:
        """A policy, float64 [S, A] or [T, S, A], as the shield lets it be carried out."""
        return table if self._shield is None else self._shield.masked(table)

    def execute(self, plan: Plan) -> Execution:
        """Take the planned action; a guarded or a remote system may have taken another one."""
        try:
            observation = self._sound(self._system.step(plan.action))
        except MerapError as error:
            self._faults += 1
            self._took(plan.action, surely=False)
            return Execution(plan.action, None, str(error), over=self._faults >= MAX_FAULTS)
        self._faults = 0
        taken = plan.action if observation.taken is None else observation.taken
        self._took(taken, surely=True)
        return Execution(taken, observation)

    def _took(self, action: int, *, surely: bool) -> None:
        if self._shield is not None:
            self._shield.took(action, surely=surely)

    def _sound(self, observation: Observation) -> Observation:
        """The observation, if it can be used.

        Raises:
            InputError: the reward is no number, or what is enabled is not said of every action.
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
