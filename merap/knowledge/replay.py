"""Go through a recorded run again, in order, and tell whether it would be decided so again."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest

from merap.knowledge.base import KnowledgeBase
from merap.knowledge.rows import DecisionRow, ObservationRow


def timeline(knowledge: KnowledgeBase, run: int) -> Iterator[ObservationRow | DecisionRow]:
    """Return observations and decisions by episode and step; a decision after the observation at its step.

    A loop may record an episode's decisions after all its observations, so this is not the order
    of recording.
    """
    streams: list[Iterator[ObservationRow | DecisionRow]] = [
        knowledge.observations(run),
        knowledge.decisions(run),
    ]
    return heapq.merge(*streams, key=lambda row: (row.episode, row.step))


@dataclass(frozen=True)
class DecisionDifference:
    """A decision that was not derived as it was recorded.

    Attributes:
        episode: during which.
        step: steps of it that were over.
        kind: kind of the decision.
        recorded: its reasons; None: it was not recorded.
        derived: its reasons when it was derived again; None: it was not.
    """

    episode: int
    step: int
    kind: str
    recorded: tuple[str, ...] | None
    derived: tuple[str, ...] | None

    def __str__(self) -> str:
        return (
            f"episode {self.episode}, step {self.step}: {self.kind}: "
            f"recorded {_reasons(self.recorded)}, derived {_reasons(self.derived)}"
        )


def _reasons(reasons: tuple[str, ...] | None) -> str:
    return "nothing" if reasons is None else f"'{'; '.join(reasons)}'"


def decision_differences(
    recorded: Iterable[DecisionRow], derived: Iterable[DecisionRow], kinds: Collection[str]
) -> tuple[DecisionDifference, ...]:
    """Find where the decisions of some kinds are not the same, in order.

    Args:
        recorded: in the knowledge base.
        derived: again, from the recorded observations.
        kinds: that are compared; others may depend on more than observations, such as on time.
    """
    reasons: dict[tuple[int, int, str], tuple[list[tuple[str, ...]], list[tuple[str, ...]]]]
    reasons = defaultdict(lambda: ([], []))
    for index, rows in enumerate((recorded, derived)):
        for row in rows:
            if row.kind in kinds:
                reasons[row.episode, row.step, row.kind][index].append(row.reasons)
    return tuple(
        DecisionDifference(*key, before, after)
        for key in sorted(reasons)
        for before, after in zip_longest(*reasons[key])
        if before != after
    )
