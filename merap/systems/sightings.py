"""Define a manager's news of an episode: whole transitions, and states seen after a gap.

Axes: S states of the canonical index (the completed state is the last).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from merap.systems.interface import Observation


@dataclass(frozen=True, eq=False)
class Transition:
    """A step of which both ends were seen.

    Attributes:
        time: number of steps of the episode before it.
        state: where it began.
        action: the action that was taken.
        target: where it led, S - 1 if the task ended.
        observation: the observation after it.
    """

    time: int
    state: int
    action: int
    target: int
    observation: Observation


@dataclass(frozen=True, eq=False)
class Sighting:
    """A state that was seen, while the step that led there was not.

    Attributes:
        state: the state.
        observation: the observation made in it.
        time: number of steps of the episode before it.
    """

    state: int
    observation: Observation
    time: int


News: TypeAlias = Transition | Sighting
