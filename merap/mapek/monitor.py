"""The monitor: puts together what the sensors deliver.

Axes: A declared actions.
"""

from __future__ import annotations

import numpy as np

from merap.errors import InputError
from merap.mapek.messages import Execution, Monitored, Sighting, Transition
from merap.mapek.sensors import Sensed, Sensors
from merap.mdp.model import Bools, Ints
from merap.systems.strategy import StateIndex


class Monitor:
    """Follows an episode, though observations may be late, lost or missing.

    Args:
        valuations: int64 [S, V], the canonical index; the completed state is the last.
        num_actions: A.
        sensors: between the system and here.
    """

    def __init__(self, valuations: Ints, num_actions: int, sensors: Sensors) -> None:
        self._index = StateIndex(valuations)
        self._sensors = sensors
        self._enabled: Bools = np.ones(num_actions, dtype=np.bool_)
        self._episode = -1
        self._actions: list[int] = []
        self._seen: Sighting | None = None
        self._seen_at = 0

    def begin(self, execution: Execution) -> Monitored:
        """An episode begins with what a reset has answered."""
        self._episode += 1
        self._actions = []
        self._seen = None
        self._enabled = np.ones_like(self._enabled)
        self._sensors.begin()
        return self._receive(execution)

    def observe(self, execution: Execution) -> Monitored:
        """A step has been taken."""
        assert execution.action is not None
        taken = None if execution.observation is None else execution.observation.taken
        self._actions.append(execution.action if taken is None else taken)
        return self._receive(execution)

    def _receive(self, execution: Execution) -> Monitored:
        step = len(self._actions)
        if execution.observation is not None:
            self._enabled = execution.observation.enabled
        news: list[Transition | Sighting] = []
        problems = [] if execution.fault is None else [execution.fault]
        for sensed in self._sensors.pass_on(step, execution.observation):
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

    def _news(self, sensed: Sensed) -> Transition | Sighting:
        """A transition if the state before was seen too."""
        sighting = Sighting(self._index(sensed.observation), sensed.observation, sensed.step)
        before, follows = self._seen, self._seen_at == sensed.step - 1
        self._seen, self._seen_at = sighting, sensed.step
        if before is None or not follows:
            return sighting
        time = sensed.step - 1
        return Transition(time, before.state, self._actions[time], sighting.state, sighting.observation)
