"""What a managed system lets its manager see and do.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from merap.mdp.model import Bools, Ints


@dataclass(frozen=True, eq=False)
class Observation:
    """What a managed system lets its manager see after a reset or a step.

    Attributes:
        valuation: int64 [V], values of the state variables.
        enabled: bool [A], the actions that are possible now.
        reward: earned by the last step; 0 after a reset.
        continuation: 0 once the task is complete, else 1 (dm_env's discount).
        truncated: the horizon is reached though the task is not complete.
        detections: name of a detector -> what it reads.
        taken: the action that the system has taken in place of the one it was asked for; None: that one.
    """

    valuation: Ints
    enabled: Bools
    reward: float
    continuation: float
    truncated: bool
    detections: Mapping[str, object] = field(default_factory=dict)
    taken: int | None = None

    @property
    def last(self) -> bool:
        """Whether the episode is over."""
        return self.truncated or self.continuation == 0


class ManagedSystem(Protocol):
    """A system under control."""

    @property
    def actions(self) -> tuple[str, ...]:
        """A names; `step` takes an index into them."""

    def reset(self) -> Observation:
        """Begin an episode."""

    def step(self, action: int) -> Observation:
        """Take an action.

        Raises:
            InputError: the action is not enabled, or the episode is over.
        """
