"""What an episode of the loop leaves behind, for knowledge base and report.

Axes: A declared actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from merap.mapek.base_extension import Extension
from merap.mapek.messages import AdaptedPolicy, Execution, Phase
from merap.mdp.model import TabularMDP

Kind = Literal["replan", "update", "settled", "extended", "fallback"]


@dataclass(frozen=True)
class Decision:
    """Something that the loop has decided.

    Attributes:
        step: so many steps of the episode were over.
        kind: what.
        reasons: why, in plain lines.
    """

    step: int
    kind: Kind
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Problem:
    """Something that went wrong outside the loop.

    Attributes:
        step: so many steps of the episode were over.
        message: in one line.
    """

    step: int
    message: str


@dataclass(frozen=True, eq=False)
class EpisodeLog:
    """An episode as the loop has seen it.

    Attributes:
        episode: counted from 0.
        phase: in which it began.
        executions: the reset and every step.
        decisions: in order.
        problems: in order.
        policy: after the episode, if it was updated.
        model: the analyzer's, if adaptation ended with the episode.
        extension: of the base, if that model was none of it.
        seconds: of wall time.
    """

    episode: int
    phase: Phase
    executions: tuple[Execution, ...] = field(repr=False)
    decisions: tuple[Decision, ...]
    problems: tuple[Problem, ...]
    policy: AdaptedPolicy | None
    model: TabularMDP | None = field(repr=False)
    extension: Extension | None
    seconds: float

    def count(self, kind: Kind) -> int:
        """How many decisions of a kind there are."""
        return sum(decision.kind == kind for decision in self.decisions)


@dataclass(frozen=True)
class EpisodeRow:
    """An episode as the report shows it; what is really there comes from the scenario.

    Where an episode begins where the last one ended, values are those of an episode from there.
    Of a system that is not simulated nobody knows what is there: optima, `expected`, `entered` and `unsafe`
    are None, and returns are as they were received.

    Attributes:
        episode: counted from 0.
        stage: in force when it ended.
        phase: in which it began.
        steps: taken.
        earned: undiscounted return, without noise.
        discounted: discounted return, without noise.
        optimum: of the model in force: expected undiscounted return of the best policy.
        discounted_optimum: likewise, discounted.
        expected: what the policy that would act if learning stopped now is worth on that model.
        entered: what the policy before the episode is worth on it; None: the model was the same.
        unsafe: steps that led into an unsafe state.
        completed: the task was completed.
        replans: how often adaptation began anew.
        updates: of the policy.
        fallbacks: actions in place of plans that were late or could not be made.
        problems: faults of the system that no retry has mended, and observations that make no sense.
        safe_optimum: as `optimum`, of the best policy within the shield's threshold; None: there is no
            shield.
        faults: kind -> how many calls to the system failed, those that a retry has mended among them.
    """

    episode: int
    stage: int
    phase: Phase
    steps: int
    earned: float
    discounted: float
    optimum: float | None
    discounted_optimum: float | None
    expected: float | None
    entered: float | None
    unsafe: int | None
    completed: bool
    replans: int
    updates: int
    fallbacks: int
    problems: int
    safe_optimum: float | None = None
    faults: Mapping[str, int] = field(default_factory=dict)

    @property
    def possible(self) -> float | None:
        """The optimum that the loop is held to."""
        return self.optimum if self.safe_optimum is None else self.safe_optimum
