"""The way of observations from the system to the monitor: late, or never.

What is enabled comes from the actuators, and that an episode is over from the system itself: both
always arrive in time.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from merap.mapek.scenario_schema import SensingSpec
from merap.systems.interface import Observation


@dataclass(frozen=True, eq=False)
class Sensed:
    """An observation, after how many steps of the episode it was made."""

    step: int
    observation: Observation


class Sensors:
    """Holds back what is delayed and drops what is lost.

    The last observation of an episode is never lost, and brings along all that is still under way.

    Args:
        spec: how long, and how often.
        generator: of what is lost.
    """

    def __init__(self, spec: SensingSpec, generator: np.random.Generator) -> None:
        self._spec = spec
        self._generator = generator
        self._under_way: deque[Sensed] = deque()

    def begin(self) -> None:
        """An episode begins; nothing of the one before is under way."""
        self._under_way.clear()

    def pass_on(self, step: int, observation: Observation | None) -> tuple[Sensed, ...]:
        """What arrives after a step.

        Args:
            step: so many steps of the episode are over.
            observation: made now; None: the system gave none.
        """
        lost = self._spec.loss > 0 and self._generator.random() < self._spec.loss
        last = observation is not None and observation.last
        if observation is not None and (last or not lost):
            self._under_way.append(Sensed(step, observation))
        arrived = []
        while self._under_way and (last or self._under_way[0].step <= step - self._spec.delay):
            arrived.append(self._under_way.popleft())
        return tuple(arrived)
