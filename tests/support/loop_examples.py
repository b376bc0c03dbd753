"""Messages and systems that the tests of the loop share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from merap.mapek.messages import Monitored
from merap.mapek.records import EpisodeRow
from merap.mdp.model import Bools, Floats
from merap.systems.interface import Observation
from merap.systems.sightings import Sighting, Transition
from merap.trigger.trigger import Alarm, Reading

NUM_ACTIONS = 5


def seen(
    row: int,
    col: int,
    reward: float = -0.5,
    *,
    ended: bool = False,
    truncated: bool = False,
    enabled: tuple[bool, ...] = (True,) * NUM_ACTIONS,
) -> Observation:
    """Return an observation on the paper's grid."""
    return Observation(
        valuation=np.array([row, col, 0]),
        enabled=np.array(enabled),
        reward=reward,
        continuation=0.0 if ended else 1.0,
        truncated=truncated,
    )


class Doubtful:
    """A trigger that alarms at the first thing its model holds all but impossible."""

    def __init__(self) -> None:
        self.readings: list[Reading] = []
        # the number of readings before each
        self.gaps: list[int] = []
        self.ends: list[int] = []
        self.replannings = 0

    def observe(self, reading: Reading) -> Alarm | None:
        self.readings.append(reading)
        if reading.log_likelihood > math.log(1e-3):
            return None
        return Alarm("change", reading.log_likelihood, math.log(1e-3), "what happened was held impossible")

    def missed(self) -> None:
        self.gaps.append(len(self.readings))

    def episode_over(self) -> Alarm | None:
        self.ends.append(len(self.readings))
        return None

    def replanned(self) -> None:
        self.replannings += 1


class Told:
    """A strategy that takes down what it is told, and always takes one action."""

    def __init__(
        self, action: int = 0, episodes_per_update: int = 1, shape: tuple[int, int] = (82, 5)
    ) -> None:
        self.action, self.episodes_per_update, self.shape = action, episodes_per_update, shape
        self.calls: list[str] = []

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        how = f"{'resumed ' if resumed else ''}at {time} in " if time or resumed else ""
        self.calls.append(f"begin {how}{observation.valuation[:2].tolist()}")

    def act(self, allowed: Bools) -> int:
        assert allowed[self.action]
        self.calls.append("act")
        return self.action

    def observe(self, action: int, observation: Observation) -> None:
        self.calls.append(f"{action} to {observation.valuation[:2].tolist()}")

    def update(self) -> None:
        self.calls.append("update")

    def policy(self) -> Floats:
        return np.broadcast_to(np.eye(self.shape[1])[self.action], self.shape)

    def explain(self) -> tuple[str, ...]:
        return ("always the same",)


def monitored(
    state: int | None,
    news: Sequence[Transition | Sighting] = (),
    *,
    step: int = 0,
    seen_state: int | None = None,
    since: tuple[int, ...] = (),
    problems: tuple[str, ...] = (),
    last: bool = False,
) -> Monitored:
    """Return a message of the monitor in the first episode, all actions enabled."""
    return Monitored(
        episode=0,
        step=step,
        news=tuple(news),
        enabled=np.ones(NUM_ACTIONS, dtype=np.bool_),
        state=state,
        seen=state if seen_state is None else seen_state,
        since=since,
        problems=problems,
        last=last,
    )


def episode_row(episode: int, stage: int, expected: float, earned: float = 4.0, **given: Any) -> EpisodeRow:
    """Return an episode of 10 steps where 6 is the optimum: within 5 % of it means at least 5.7."""
    return EpisodeRow(
        **{
            "episode": episode,
            "stage": stage,
            "phase": "executing",
            "steps": 10,
            "earned": earned,
            "discounted": earned / 2,
            "optimum": 6.0,
            "discounted_optimum": 5.0,
            "expected": expected,
            "entered": None,
            "unsafe": 0,
            "completed": True,
            "replans": 0,
            "updates": 0,
            "fallbacks": 0,
            "problems": 0,
            **given,
        }
    )
