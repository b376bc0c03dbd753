"""A system whose first episodes are recorded, so that a resumed loop repeats them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from merap.errors import MerapError
from merap.knowledge.rows import ObservationRow
from merap.mapek.run_store import RecordedEpisode
from merap.systems.interface import ManagedSystem, Observation


class RecordedSystem:
    """Answers from records, whatever is done; after them the live system goes on.

    Args:
        episodes: the recorded ones.
        live: the system itself.
    """

    def __init__(self, episodes: Sequence[RecordedEpisode], live: ManagedSystem) -> None:
        self._episodes = episodes
        self._live = live
        self._episode = -1
        self._step = 0

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._live.actions

    def reset(self) -> Observation:
        """Begin an episode."""
        self._episode += 1
        self._step = 0
        return self._answer() if self._episode < len(self._episodes) else self._live.reset()

    def step(self, action: int) -> Observation:
        """Take an action."""
        self._step += 1
        return self._answer() if self._episode < len(self._episodes) else self._live.step(action)

    def _answer(self) -> Observation:
        episode = self._episodes[self._episode]
        rows = episode.observations
        if self._step >= len(rows):
            raise MerapError(f"episode {self._episode} has only {len(rows) - 1} recorded steps")
        return _observation(rows[self._step], episode.taken.get(self._step), len(self.actions))


def _observation(row: ObservationRow, taken: int | None, num_actions: int) -> Observation:
    if row.valuation is None or row.enabled is None:
        raise MerapError("nothing was observed then")
    return Observation(
        valuation=np.array(row.valuation, dtype=np.int64),
        enabled=np.array(row.enabled, dtype=np.bool_).reshape(num_actions),
        reward=row.reward,
        continuation=row.continuation,
        truncated=row.truncated,
        detections=row.detections,
        taken=taken,
    )
