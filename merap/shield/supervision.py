"""Violations of a system that is really met: counted from outside, whoever acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from merap.shield.shield import ShieldReport
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem


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


class Supervised:
    """A simulated system whose violations are counted; see `systems.ManagedSystem`.

    Args:
        system: what is met, made from a combination.
    """

    def __init__(self, system: SimulatedSystem) -> None:
        self._system = system
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
        if not self._violated and self._system.unsafe:
            self._violated = True
            self._violations += 1
        return observation

    def safety(self, shield: ShieldReport | None) -> Safety:
        """What happened so far, beside what the shield did."""
        return Safety(self._episodes, self._violations, self._completed, shield)
