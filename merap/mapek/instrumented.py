"""The managed system as the report sees it: it counts, and knows its ground truth if anyone does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from merap.mapek.scenario import Stage
from merap.mdp.model import TabularMDP
from merap.strategies.ground_truth import GroundTruth
from merap.systems.interface import ManagedSystem


@dataclass(frozen=True)
class Tally:
    """Counts of an episode; a simulated system counts before any noise.

    Attributes:
        steps: taken.
        earned: the undiscounted return.
        discounted: the discounted one.
        unsafe: steps that led into an unsafe state; None: nobody knows.
        completed: the task is complete.
        faults: kind -> number of failed calls, those that a retry has mended included.
    """

    steps: int = 0
    earned: float = 0.0
    discounted: float = 0.0
    unsafe: int | None = 0
    completed: bool = False
    faults: Mapping[str, int] = field(default_factory=dict)


class InstrumentedSystem(ManagedSystem, Protocol):
    """A managed system that keeps count, and tells the report its ground truth if it is known."""

    @property
    def horizon(self) -> int:
        """Steps of an episode."""

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The stages of the scenario, in order; empty: nobody knows."""

    @property
    def stage(self) -> int:
        """The number of the stage in force."""

    @property
    def models(self) -> tuple[TabularMDP, ...]:
        """The whole models of the systems that are met; empty: nobody knows."""

    @property
    def truth(self) -> GroundTruth | None:
        """The system as it really is now; None: nobody knows."""

    @property
    def tally(self) -> Tally:
        """Counts of the episode."""

    def begin(self, episode: int) -> None:
        """Begin the episode with this number, counted from 0; its reset may fail before it gets here."""

    def snapshot(self) -> dict[str, Any] | None:
        """Return all of the state, as JSON has it; None: it can't be restored."""

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Go on from a snapshot.

        Raises:
            InputError: it is none of such a system.
        """
