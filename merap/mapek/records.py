"""Records of an episode of the loop, for knowledge base and report.

Axes: A declared actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from merap.mapek.base_extension import BaseExtension
from merap.mapek.messages import AdaptedPolicy, Execution, Phase
from merap.mdp.model import TabularMDP

Kind = Literal["replan", "update", "settled", "extended", "fallback"]


@dataclass(frozen=True)
class Decision:
    """A decision of the loop.

    Attributes:
        step: number of steps of the episode before it.
        kind: kind of the decision.
        reasons: why, in plain lines.
    """

    step: int
    kind: Kind
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Problem:
    """A fault outside the loop.

    Attributes:
        step: number of steps of the episode before it.
        message: in one line.
    """

    step: int
    message: str


@dataclass(frozen=True, eq=False)
class EpisodeLog:
    """An episode as the loop saw it.

    Attributes:
        episode: counted from 0.
        phase: in which it began.
        executions: the reset and every step.
        decisions: in order.
        problems: in order.
        policy: after the episode, if it was updated.
        model: model of the analyzer, if adaptation ended with the episode.
        extension: extension of the base, if the model was outside it.
        seconds: wall time.
    """

    episode: int
    phase: Phase
    executions: tuple[Execution, ...] = field(repr=False)
    decisions: tuple[Decision, ...]
    problems: tuple[Problem, ...]
    policy: AdaptedPolicy | None
    model: TabularMDP | None = field(repr=False)
    extension: BaseExtension | None
    seconds: float

    def count(self, kind: Kind) -> int:
        """Return the number of decisions of a kind."""
        return sum(decision.kind == kind for decision in self.decisions)


@dataclass(frozen=True)
class EpisodeRow:
    """An episode as the report shows it, scored by the ground truth of the scenario.

    If an episode begins where the last one ended, its values are those of an episode from there.
    A system that is not simulated has no known ground truth: optima, `expected`, `entered` and `unsafe`
    are None, and returns are as they were received.

    Attributes:
        episode: counted from 0.
        stage: in force when it ended.
        phase: in which it began.
        steps: taken.
        earned: undiscounted return, without noise.
        discounted: discounted return, without noise.
        optimum: expected undiscounted return of the best policy on the model in force.
        discounted_optimum: the same, discounted.
        expected: value on that model of the policy that would act if learning stopped now.
        entered: value on it of the policy before the episode; None: the model was the same.
        unsafe: steps that led into an unsafe state.
        completed: the task was completed.
        replans: number of times that adaptation began anew.
        updates: updates of the policy.
        fallbacks: actions in place of plans that were late or could not be made.
        problems: faults of the system that no retry has mended, and observations that make no sense.
        safe_optimum: as `optimum`, of the best policy within the shield's threshold; None: there is no
            shield.
        faults: kind -> number of failed calls to the system, those that a retry has mended included.
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
        """The optimum within the shield's threshold if there is a shield, else the optimum."""
        return self.optimum if self.safe_optimum is None else self.safe_optimum
