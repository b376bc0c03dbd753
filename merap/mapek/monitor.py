"""The monitor: receives what the sensors deliver, late or never, and says where the system is.

Axes: A declared actions, S states of the index.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from merap.errors import InputError
from merap.mapek.messages import Execution, Monitored
from merap.mapek.scenario_schema import SensingSpec
from merap.mdp.index import FamilyIndex
from merap.mdp.model import Bools
from merap.systems.interface import Observation
from merap.systems.sightings import News, Sighting, Transition
from merap.systems.strategy import StateIndex


@dataclass(frozen=True, eq=False)
class Sensed:
    """An observation, and the number of steps of the episode before it."""

    step: int
    observation: Observation


class Sensors:
    """Hold back late observations and drop lost ones.

    The last observation of an episode is never lost, and brings along all that is still under way. The
    enabled actions come from the actuators, and the end of an episode from the system itself: both
    always arrive in time.

    Args:
        spec: the delay, and the probability of a loss.
        generator: draws the losses.
    """

    def __init__(self, spec: SensingSpec, generator: np.random.Generator) -> None:
        self._spec = spec
        self._generator = generator
        self._under_way: deque[Sensed] = deque()

    def clear(self) -> None:
        """Drop observations under way, since an episode begins."""
        self._under_way.clear()

    def deliver(self, step: int, observation: Observation | None) -> tuple[Sensed, ...]:
        """Return the observations that arrive after a step.

        Args:
            step: number of steps of the episode so far.
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


class Monitor:
    """Follows an episode, though observations may be late, lost or missing.

    Args:
        index: S states.
        num_actions: A.
        sensors: between the system and here.
    """

    def __init__(self, index: FamilyIndex, num_actions: int, sensors: Sensors) -> None:
        self._index = StateIndex(index)
        self._sensors = sensors
        self._enabled: Bools = np.ones(num_actions, dtype=np.bool_)
        self._episode = -1
        self._actions: list[int] = []
        self._seen: Sighting | None = None
        self._seen_at = 0

    def receive(self, execution: Execution) -> Monitored:
        """Report on the state after a step, or after a reset, which begins an episode."""
        if execution.action is None:
            self._begin()
        else:
            self._actions.append(execution.action)
        step = len(self._actions)
        if execution.observation is not None:
            self._enabled = execution.observation.enabled
        news: list[News] = []
        problems = [] if execution.fault is None else [execution.fault]
        for sensed in self._sensors.deliver(step, execution.observation):
            try:
                news.append(self._news(sensed))
            except InputError as error:
                problems.append(str(error))
        known = self._seen is not None and self._seen_at == step
        seen = None if self._seen is None else self._seen.state
        return Monitored(
            episode=self._episode,
            step=step,
            news=tuple(news),
            enabled=self._enabled,
            state=seen if known else None,
            seen=seen,
            since=tuple(self._actions[self._seen_at :]),
            problems=tuple(problems),
            last=execution.over or (execution.observation is not None and execution.observation.last),
        )

    def _begin(self) -> None:
        self._episode += 1
        self._actions = []
        self._seen, self._seen_at = None, 0
        self._enabled = np.ones_like(self._enabled)
        self._sensors.clear()

    def _news(self, sensed: Sensed) -> News:
        """Return a transition if the state before was seen too, else a sighting."""
        sighting = Sighting(self._index(sensed.observation), sensed.observation, sensed.step)
        before, follows = self._seen, self._seen_at == sensed.step - 1
        self._seen, self._seen_at = sighting, sensed.step
        if before is None or not follows:
            return sighting
        time = sensed.step - 1
        return Transition(time, before.state, self._actions[time], sighting.state, sighting.observation)
