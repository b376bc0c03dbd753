"""What the parts of the loop tell each other.

    Execution -> Monitored -> Analysis -> Plan -> Execution -> ..., and AdaptedPolicy after each update

Axes: T steps, S states of the canonical index (the completed state is the last), A declared actions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from merap.mdp.model import Bools, Floats
from merap.systems.interface import Observation

# Adapting: the learner changes the policy and explores. Executing: the policy is carried out as it is.
Phase = Literal["adapting", "executing"]
# Who chose an action: the learner that explores, the policy it has made, the same policy where the
# state is not seen but predicted, or nobody, in time.
Source = Literal["exploration", "policy", "prediction", "fallback"]


@dataclass(frozen=True, eq=False)
class Execution:
    """The executor to the monitor: what has been done to the system, and what it answered.

    Attributes:
        action: that was taken; None: the system was reset.
        observation: the answer; None: there is none.
        fault: why there is none, in one line.
        over: nothing more can be done in this episode.
    """

    action: int | None
    observation: Observation | None
    fault: str | None = None
    over: bool = False


@dataclass(frozen=True, eq=False)
class Transition:
    """A step that was seen whole.

    Attributes:
        time: so many steps of the episode were over when it began.
        state: where it began.
        action: what was done.
        target: where it led, S - 1 if the task ended.
        observation: of its end.
    """

    time: int
    state: int
    action: int
    target: int
    observation: Observation


@dataclass(frozen=True, eq=False)
class Sighting:
    """A state that was seen, while how the system came there was not.

    Attributes:
        state: the state.
        observation: of it.
        time: so many steps of the episode were over.
    """

    state: int
    observation: Observation
    time: int


@dataclass(frozen=True, eq=False)
class Monitored:
    """The monitor to analyzer and learner: what is known after a step.

    Attributes:
        episode: counted from 0.
        step: so many steps of it are over.
        news: what has arrived with this step, in order; nothing, where observations are late or lost.
        enabled: bool [A], the actions that are possible now.
        state: where the system is now; None: not known.
        seen: the last state that was seen; None: none in this episode.
        since: the actions since then.
        problems: faults of the system, and states that the case does not have, which count as not seen.
        last: the episode is over.
    """

    episode: int
    step: int
    news: tuple[Transition | Sighting, ...]
    enabled: Bools
    state: int | None
    seen: int | None
    since: tuple[int, ...]
    problems: tuple[str, ...]
    last: bool


@dataclass(frozen=True, eq=False)
class Analysis:
    """The analyzer to planner and learner: what it means.

    Attributes:
        phase: which it is.
        whereabouts: float64 [S], the probability of each state now, by the analyzer's model.
        replan: the policy is to be adapted again.
        reasons: why, in plain lines.
    """

    phase: Phase
    whereabouts: Floats
    replan: bool = False
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """The planner to the executor: what to do next.

    Attributes:
        action: its number.
        source: who chose it.
        reason: of a fallback, in one line.
    """

    action: int
    source: Source
    reason: str = ""


@dataclass(frozen=True, eq=False)
class AdaptedPolicy:
    """The learner to planner and knowledge base: the policy after an update.

    Attributes:
        update: of this adaptation; 0: before the first one.
        table: float64 [S, A] or [T, S, A].
        reasons: what the learner concluded, in plain lines.
    """

    update: int
    table: Floats = field(repr=False)
    reasons: tuple[str, ...]
