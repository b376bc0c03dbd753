"""Define the rows that go into the knowledge base and come out of it.

Axes: V state variables, A declared actions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from merap.errors import InputError

if TYPE_CHECKING:
    from merap.systems.interface import Observation

PolicyKind: TypeAlias = Literal["meta", "adapted"]
Level: TypeAlias = Literal["debug", "info", "warning", "error"]


def now() -> datetime:
    """Return the time, in UTC."""
    return datetime.now(UTC)


@dataclass(frozen=True)
class ObservationRow:
    """An observation of a system, with the action that led to it.

    Attributes:
        episode: counted from 0.
        step: steps of the episode that are over; 0 after a reset.
        valuation: [V], values of the state variables; None if nothing was seen.
        action: its number; None for a reset.
        reward: finite.
        continuation: 0 once the task is complete, else 1.
        truncated: the horizon is reached though the task is not complete.
        detections: name of a detector -> what it reads.
        enabled: [A], the actions that are possible now; None if not known.
    """

    episode: int
    step: int
    valuation: tuple[int, ...] | None
    action: int | None
    reward: float
    continuation: float
    truncated: bool
    detections: Mapping[str, Any] = field(default_factory=dict)
    enabled: tuple[bool, ...] | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.reward):
            key = f"observation of episode {self.episode}, step {self.step}"
            raise InputError(f"the reward is {self.reward}, expected a finite number", key=key)

    @classmethod
    def of(cls, episode: int, step: int, action: int | None, observation: Observation) -> ObservationRow:
        """Build the row of an observation."""
        return cls(
            episode=episode,
            step=step,
            valuation=tuple(observation.valuation.tolist()),
            action=action,
            reward=float(observation.reward),
            continuation=float(observation.continuation),
            truncated=bool(observation.truncated),
            detections=dict(observation.detections),
            enabled=tuple(observation.enabled.tolist()),
        )


@dataclass(frozen=True)
class DecisionRow:
    """A decision of a part of the loop, with its reasons.

    Attributes:
        episode: during which it was made.
        step: steps of it that were over.
        kind: a word for it, as `replan`.
        reasons: plain lines.
        data: figures, as JSON.
    """

    episode: int
    step: int
    kind: str
    reasons: tuple[str, ...] = ()
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class EventRow:
    """A line of the log.

    Attributes:
        time: aware.
        component: the part of the loop that says it.
        level: its severity.
        message: one line.
        data: figures, as JSON.
    """

    time: datetime
    component: str
    level: Level
    message: str
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ModelRow:
    """A model that was recorded.

    Attributes:
        id: by which policies refer to it.
        name: as its combination.
        digest: SHA-256 of its UMB archive, by which `blob` finds it.
    """

    id: int
    name: str
    digest: str


@dataclass(frozen=True)
class PolicyRow:
    """A policy that was recorded.

    Attributes:
        id: its number.
        kind: `meta` or `adapted`.
        step: policy updates so far.
        digest: SHA-256 of its tensors (safetensors), by which `blob` finds them.
        model: the model it was made for; None if there is none.
    """

    id: int
    kind: PolicyKind
    step: int
    digest: str
    model: int | None


@dataclass(frozen=True)
class CheckpointRow:
    """The record of a state that a run can go on from.

    Attributes:
        episode: number of episodes that are over.
        digest: SHA-256 of the state, by which `blob` finds it.
    """

    episode: int
    digest: str


@dataclass(frozen=True)
class Checkpoint:
    """A state that a run can go on from.

    Attributes:
        episode: number of episodes that are over.
        state: as the loop has recorded it.
    """

    episode: int
    state: bytes = field(repr=False)


@dataclass(frozen=True)
class ReportRow:
    """The report of a run that has ended.

    Attributes:
        report: as JSON.
    """

    report: Mapping[str, Any]


@dataclass(frozen=True)
class RunRow:
    """A run of the loop.

    Attributes:
        id: its number in this knowledge base.
        name: given by the user.
        case: name of the case.
        digest: digest of the case.
        settings: as JSON.
        started: when it began.
        finished: when its last report was recorded; None: it goes on, or was killed.
        report: the last one.
    """

    id: int
    name: str
    case: str
    digest: str
    settings: Mapping[str, Any]
    started: datetime
    finished: datetime | None
    report: Mapping[str, Any] | None


Row: TypeAlias = ObservationRow | DecisionRow | EventRow | ModelRow | PolicyRow | CheckpointRow | ReportRow


@dataclass(frozen=True)
class Entry:
    """An entry in the history of a run.

    Attributes:
        position: in that history, counted from 1, over rows of every kind.
        recorded: when it was.
        row: its content.
    """

    position: int
    recorded: datetime
    row: Row
