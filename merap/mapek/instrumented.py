"""What the loop controls, as the report sees it: simulated, or a system that is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from merap.mapek.ground_truth import Truth
from merap.mapek.scenario import Stage
from merap.systems.interface import ManagedSystem


@dataclass(frozen=True)
class Tally:
    """What an episode has brought; of a simulation: before any noise.

    Attributes:
        steps: taken.
        earned: the undiscounted return.
        discounted: the discounted one.
        unsafe: steps that led into an unsafe state; None: nobody knows.
        completed: the task is complete.
        faults: kind -> how many calls failed, those that a retry has mended among them.
    """

    steps: int = 0
    earned: float = 0.0
    discounted: float = 0.0
    unsafe: int | None = 0
    completed: bool = False
    faults: Mapping[str, int] = field(default_factory=dict)


class MetSystem(ManagedSystem, Protocol):
    """A managed system that keeps count, and tells the report what is known of it."""

    @property
    def horizon(self) -> int:
        """Steps of an episode."""

    @property
    def stages(self) -> tuple[Stage, ...]:
        """What is there, one after the other; none: nobody knows."""

    @property
    def stage(self) -> int:
        """The number of the stage in force."""

    @property
    def truth(self) -> Truth | None:
        """What is really there now; None: nobody knows."""

    @property
    def tally(self) -> Tally:
        """Of the episode."""

    def begin(self, episode: int) -> None:
        """The episode with this number, counted from 0, begins; its reset may fail before it gets here."""

    def snapshot(self) -> dict[str, Any] | None:
        """All of the state, as JSON has it; None: it can't be taken up again."""

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from a snapshot.

        Raises:
            InputError: it is none of such a system.
        """
