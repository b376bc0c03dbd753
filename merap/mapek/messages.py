"""The messages between the components of the loop.

    Execution -> Monitored -> Analysis -> Plan -> Execution -> ..., and AdaptedPolicy after each update

Axes: T steps, S states of the canonical index (the completed state is the last), A declared actions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from merap.mdp.model import Bools, Floats
from merap.systems.interface import Observation
from merap.systems.sightings import News

# Adapting: the learner explores and changes the policy. Executing: the policy is carried out unchanged.
Phase = Literal["adapting", "executing"]
# Who chose an action: the exploring learner, its policy in the state that is seen, its policy in the states
# where the system may be, or nobody in time.
Source = Literal["exploration", "policy", "prediction", "fallback"]


@dataclass(frozen=True, eq=False)
class Execution:
    """From the executor to the monitor: an action and the answer of the system.

    Attributes:
        action: the action that was taken; None: the system was reset.
        observation: the answer; None: there is none.
        fault: why there is no answer, in one line.
        over: nothing more can be done in this episode.
    """

    action: int | None
    observation: Observation | None
    fault: str | None = None
    over: bool = False


@dataclass(frozen=True, eq=False)
class Monitored:
    """From the monitor to analyzer, shield, learner and planner: the knowledge after a step.

    Attributes:
        episode: counted from 0.
        step: number of steps of the episode so far.
        news: transitions and sightings that arrive with this step; none where observations are late or lost.
        enabled: bool [A], the actions that are possible now.
        state: where the system is now; None: not known.
        seen: the last state that was seen; None: none in this episode.
        since: the actions since then.
        problems: faults of the system, and states that the case does not have, which count as not seen.
        last: the episode is over.
    """

    episode: int
    step: int
    news: tuple[News, ...]
    enabled: Bools
    state: int | None
    seen: int | None
    since: tuple[int, ...]
    problems: tuple[str, ...]
    last: bool


@dataclass(frozen=True, eq=False)
class Analysis:
    """From the analyzer to shield, learner and planner: the phase, and whether to adapt again.

    Attributes:
        phase: the phase after this step.
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
    """From the planner to the executor: the next action.

    Attributes:
        action: its number.
        source: who chose it.
        reason: why the planner fell back, in one line.
    """

    action: int
    source: Source
    reason: str = ""


@dataclass(frozen=True, eq=False)
class AdaptedPolicy:
    """From the learner to planner and knowledge base: the policy after an update.

    Attributes:
        update: number of updates of this adaptation; 0: before the first one.
        table: float64 [S, A] or [T, S, A].
        reasons: the conclusions of the learner, in plain lines.
    """

    update: int
    table: Floats = field(repr=False)
    reasons: tuple[str, ...]
