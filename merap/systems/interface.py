"""Define the interface of a managed system: observations, actions and faults.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Protocol

from merap.errors import MerapError
from merap.masking import masked
from merap.mdp.model import Bools, Ints

# timeout: no answer in time; refused: no connection; dropped: the connection broke amid an answer;
# malformed: the answer is not what the schema says; failed: the system reports a fault of its own;
# rejected: it refuses the request; missed: it has gone on by itself, or someone else manages it too;
# gone: no episode could begin, several times in a row.
FaultKind = Literal["timeout", "refused", "dropped", "malformed", "failed", "rejected", "missed", "gone"]


class SystemFault(MerapError):  # noqa: N818 (what happens to a system is a fault; errors are ours)
    """A managed system can't be reached or doesn't behave; `str(error)` is one clear line.

    Args:
        kind: see `FaultKind`.
        message: the event and its place.
        repeatable: the same call may be made again and does not act twice.
    """

    exit_code: ClassVar[int] = 3

    def __init__(self, kind: FaultKind, message: str, *, repeatable: bool = True) -> None:
        self.kind = kind
        self.message = masked(" ".join(message.split()))
        self.repeatable = repeatable
        super().__init__(f"{kind}: {self.message}")


@dataclass(frozen=True, eq=False)
class Observation:
    """An observation of a managed system after a reset or a step.

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
