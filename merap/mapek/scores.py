"""Scores of a run of the loop: time to react, return, and violations.

Axes: E episodes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

import numpy as np

from merap.mapek.records import EpisodeRow
from merap.mapek.scenario import Stage
from merap.mdp.short_repr import ShortRepr
from merap.strategies.evaluation import Range, lasting
from merap.systems.interface import SystemFault

Number = TypeVar("Number", int, float)


@dataclass(frozen=True)
class Reaction:
    """The reaction of the loop to a change.

    The loop has recovered when the policy that would act if learning stopped is within 5 % of the
    optimum, which is that within the shield's threshold if there is a shield, and still is after the
    next two episodes. A change that does not harm the policy needs no reaction: all three times are 0.

    Attributes:
        episode: in which the change took effect.
        changed: the concerns.
        replanned: the first episode from there on in which adaptation began anew; None: in none
            before the next change.
        episodes: number of episodes until the loop had recovered; None: it had not before the next change.
        steps: the same in steps.
        lost: the optimum less the return, summed until then or until the next change.
        step: number of steps of its episode before the change.
    """

    episode: int
    changed: tuple[str, ...]
    replanned: int | None
    episodes: int | None
    steps: int | None
    lost: float
    step: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class LoopReport(ShortRepr):
    """A run of the loop.

    Attributes:
        scenario: its name.
        manager: name of the manager.
        case: name of the case.
        seed: seed of everything random.
        rows: one for each episode.
        reactions: one for each change that took effect.
        shield: report of the shield; None: there is none.
        seconds: float [E], wall time of each episode; it never repeats.
        ended_by: the fault that ended it before its last episode; None: there was none.
    """

    scenario: str
    manager: str
    case: str
    seed: int
    rows: tuple[EpisodeRow, ...] = field(repr=False)
    reactions: tuple[Reaction, ...]
    shield: Mapping[str, Any] | None
    seconds: tuple[float, ...] = field(repr=False)
    ended_by: SystemFault | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON has it; all that depends on the clock is under `times`."""
        return {
            "scenario": self.scenario,
            "manager": self.manager,
            "case": self.case,
            "seed": self.seed,
            "summary": summary(self.rows, self.reactions),
            "reactions": [asdict(reaction) for reaction in self.reactions],
            "episodes": [asdict(row) for row in self.rows],
            "shield": self.shield,
            "ended_by": None if self.ended_by is None else str(self.ended_by),
            "times": {
                "seconds_per_episode": list(self.seconds),
                "seconds_to_recover": [self.seconds_to_recover(reaction) for reaction in self.reactions],
            },
        }

    def seconds_to_recover(self, reaction: Reaction) -> float | None:
        """Return the wall time of the episodes until the loop had recovered; None: it had not."""
        if reaction.episodes is None:
            return None
        return float(sum(self.seconds[reaction.episode : reaction.episode + reaction.episodes]))


def reactions(rows: Sequence[EpisodeRow], stages: Sequence[Stage]) -> tuple[Reaction, ...]:
    """Return the reaction of the loop to each change that took effect.

    Args:
        rows: rows of all episodes.
        stages: stages of the scenario.
    """
    found = []
    for number in range(1, len(stages)):
        mine = [row for row in rows if row.stage == number]
        if mine:
            found.append(_reaction(mine, stages[number]))
    return tuple(found)


def _reaction(rows: Sequence[EpisodeRow], stage: Stage) -> Reaction:
    first = rows[0]
    possible = first.possible
    assert possible is not None
    values = _known([first.entered, *(row.expected for row in rows)])
    reachable = Range(possible, min([possible, *values]))
    recovered = lasting([reachable.within_5_percent(value) for value in values])
    until = rows if recovered is None else rows[:recovered]
    return Reaction(
        episode=first.episode,
        changed=stage.changed,
        replanned=next((row.episode for row in rows if row.replans), None),
        episodes=recovered,
        steps=None if recovered is None else sum(row.steps for row in until),
        lost=float(sum(possible - row.earned for row in until)),
        step=stage.begins.step if first.episode == stage.begins.episode else 0,
    )


def summary(rows: Sequence[EpisodeRow], reacted: Sequence[Reaction]) -> dict[str, Any]:
    """Return figures over all episodes, and means over the reactions; None: nobody knows."""
    episodes = [reaction.episodes for reaction in reacted if reaction.episodes is not None]
    optima = _known([row.optimum for row in rows])
    unsafe = _known([row.unsafe for row in rows])
    return {
        "episodes": len(rows),
        "mean_return": _mean([row.earned for row in rows]),
        "mean_discounted_return": _mean([row.discounted for row in rows]),
        "mean_optimum": _mean(optima),
        "mean_safe_optimum": _mean(_known([row.safe_optimum for row in rows])),
        "regret": float(sum(optima) - sum(row.earned for row in rows)) if optima else None,
        "completed": sum(row.completed for row in rows),
        "violations": sum(count > 0 for count in unsafe) if unsafe else None,
        "unsafe_steps": sum(unsafe) if unsafe else None,
        "adaptations": sum(row.replans for row in rows),
        "policy_updates": sum(row.updates for row in rows),
        "fallbacks": sum(row.fallbacks for row in rows),
        "problems": sum(row.problems for row in rows),
        "faults": dict(sum((Counter(row.faults) for row in rows), Counter())),
        "changes": len(reacted),
        "changes_recovered_from": len(episodes),
        "mean_episodes_to_recover": _mean(episodes),
    }


def _known(values: Sequence[Number | None]) -> list[Number]:
    return [value for value in values if value is not None]


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
