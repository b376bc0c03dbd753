"""The executor: does to the system what is planned, within what the shield allows.

Axes: S states of the canonical index (the completed state is the last), A declared actions.
"""

from __future__ import annotations

import math

import numpy as np

from merap.errors import InputError, MerapError
from merap.mdp.model import Bools
from merap.online.loop.messages import Analysis, Execution, Monitored, Plan, Sighting, Transition
from merap.online.shield.shield import Shield
from merap.online.systems import ManagedSystem, Observation

# Where the system is not seen, the shield must allow an action in every state as probable as this.
PROBABLE = 0.01
# An episode is given up after so many faults in a row.
MAX_FAULTS = 3


class Executor:
    """Acts on the managed system; a fault of it never gets any further than here.

    Args:
        system: under control.
        shield: what is safe enough; None: everything.
    """

    def __init__(self, system: ManagedSystem, shield: Shield | None) -> None:
        self._system = system
        self._shield = shield
        self._faults = 0
        self._begun = False

    def reset(self) -> Execution:
        """Begin an episode."""
        self._faults = 0
        self._begun = False
        try:
            return Execution(None, self._sound(self._system.reset()))
        except MerapError as error:
            return Execution(None, None, str(error), over=True)

    def allowed(self, monitored: Monitored, analysis: Analysis) -> Bools:
        """bool [A], what may be done now, never empty."""
        if self._shield is None:
            return monitored.enabled
        self._shield.refresh()
        self._follow(self._shield, monitored)
        mask = monitored.enabled
        for state in np.flatnonzero(analysis.whereabouts[:-1] >= PROBABLE):
            both = mask & self._shield.allowed(int(state), monitored.enabled)
            mask = both if both.any() else mask
        return mask

    def _follow(self, shield: Shield, monitored: Monitored) -> None:
        """Tell the shield what was seen; after a gap it begins anew."""
        for news in monitored.news:
            if isinstance(news, Transition) and self._begun:
                shield.took(news.action, news.target)
            elif not news.observation.last:
                state = news.state if isinstance(news, Sighting) else news.target
                shield.begin(state)
                self._begun = True

    def end(self, monitored: Monitored) -> None:
        """The episode is over."""
        if self._shield is not None:
            self._follow(self._shield, monitored)

    def execute(self, plan: Plan) -> Execution:
        """Take the planned action; a guarded or a remote system may have taken another one."""
        try:
            observation = self._sound(self._system.step(plan.action))
        except MerapError as error:
            self._faults += 1
            return Execution(plan.action, None, str(error), over=self._faults >= MAX_FAULTS)
        self._faults = 0
        taken = plan.action if observation.taken is None else observation.taken
        return Execution(taken, observation)

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
