"""Violations of a system that is really met: counted from outside, whoever acts.

Axes: S states of the canonical index, the completed state is the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from merap.concerns.combination import Combination
from merap.concerns.steps import holds_in_states
from merap.concerns.synthesis import synthesise
from merap.errors import InputError
from merap.mdp.canonical import COMPLETE_LABEL
from merap.mdp.model import Bools
from merap.online.shield.models import UNSAFE_LABEL
from merap.online.shield.shield import ShieldReport
from merap.online.strategy import StateIndex
from merap.online.systems import ManagedSystem, Observation


@dataclass(frozen=True)
class Safety:
    """What happened in the episodes of one adaptation.

    Attributes:
        episodes: how many began.
        violations: episodes in which an unsafe state was reached.
        completed: episodes in which the task was completed.
        shield: what the shield did; None: there was none.
    """

    episodes: int
    violations: int
    completed: int
    shield: ShieldReport | None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "episodes": self.episodes,
            "violations": self.violations,
            "completed": self.completed,
            "shield": None if self.shield is None else self.shield.as_dict(),
        }


def total(found: Sequence[Safety]) -> dict[str, Any]:
    """Sums over adaptations, for JSON."""
    shields = [one.shield for one in found if one.shield is not None]
    sums = {
        "episodes": sum(one.episodes for one in found),
        "violations": sum(one.violations for one in found),
        "completed": sum(one.completed for one in found),
    }
    if not shields:
        return {**sums, "shield": None}
    counts = {
        name: sum(getattr(one, name) for one in shields)
        for name in ("steps", "beyond_from_start", "fallbacks", "withheld", "changes")
    }
    worst = max(one.worst_risk for one in shields)
    return {**sums, "shield": {"threshold": shields[0].threshold, **counts, "worst_risk": worst}}


def unsafe_of(system: Combination, *, required: bool = False) -> Bools | None:
    """bool [S], the unsafe states of a system; None if they can't be supervised.

    They can't if the objective declares none, or if the task can be completed in an unsafe state: on
    the canonical index, which has one completed state, that violation could not be seen.

    Raises:
        InputError: it is required, and the task can be completed in an unsafe state.
    """
    condition = system.objective.unsafe
    if condition is None:
        return None
    whole = synthesise(system)
    hidden = np.flatnonzero(whole.reachable & whole.labels[COMPLETE_LABEL] & whole.labels[UNSAFE_LABEL])
    if len(hidden) and not required:
        return None
    if len(hidden):
        raise InputError(
            f"{system.name}: the task can be completed in the unsafe state "
            f"{whole.describe_state(int(hidden[0]))}, where a violation can't be counted; let it go on there"
        )
    return np.append(holds_in_states(system, condition), False)


class Supervised:
    """A managed system whose violations are counted; see `systems.ManagedSystem`.

    Args:
        system: what is met.
        index: of its case.
        unsafe: bool [S].
    """

    def __init__(self, system: ManagedSystem, index: StateIndex, unsafe: Bools) -> None:
        self._system = system
        self._index = index
        self._unsafe = unsafe
        self._episodes = self._violations = self._completed = 0
        self._violated = False

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._system.actions

    def reset(self) -> Observation:
        """Begin an episode."""
        self._episodes += 1
        self._violated = False
        return self._seen(self._system.reset())

    def step(self, action: int) -> Observation:
        """Take an action."""
        observation = self._seen(self._system.step(action))
        self._completed += observation.continuation == 0
        return observation

    def _seen(self, observation: Observation) -> Observation:
        if not self._violated and self._unsafe[self._index(observation)]:
            self._violated = True
            self._violations += 1
        return observation

    def safety(self, shield: ShieldReport | None) -> Safety:
        """What happened so far, beside what the shield did."""
        return Safety(self._episodes, self._violations, self._completed, shield)
