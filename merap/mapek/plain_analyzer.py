"""The analyzer of a family over which no belief is kept: it counts the updates of the learner.

Axes: S states of the index.
"""

from __future__ import annotations

import numpy as np

from merap.mapek.messages import AdaptedPolicy, Analysis, Monitored, Phase
from merap.mdp.model import Floats


class PlainAnalyzer:
    """Ends an adaptation after a number of updates; without a model it never notices a change.

    Args:
        num_states: S.
        updates: policy updates of an adaptation; None: it never ends.
    """

    def __init__(self, num_states: int, updates: int | None) -> None:
        self._num_states = num_states
        self._updates = updates
        self._phase: Phase = "adapting"

    def analyse(self, monitored: Monitored) -> Analysis:
        """Say where the system is, or else where it was last seen."""
        return Analysis(self._phase, self._whereabouts(monitored))

    def enough(self, policy: AdaptedPolicy) -> bool:
        """Return whether an adaptation ends with this update."""
        return self._updates is not None and policy.update >= self._updates

    def settle(self, table: Floats) -> None:
        """Let the policy be carried out as it is."""
        self._phase = "executing"

    def explain(self) -> tuple[str, ...]:
        """Tell why the adaptation has ended."""
        return (f"adapted by {self._updates} policy updates; no belief is kept over this family",)

    def tabular(self) -> None:
        """Return no model: there is none."""

    def _whereabouts(self, monitored: Monitored) -> Floats:
        """Return float64 [S], all weight on the state, or on the last one seen; any state before that."""
        last = monitored.seen if monitored.state is None else monitored.state
        if last is None:
            return np.full(self._num_states, 1 / self._num_states)
        where = np.zeros(self._num_states)
        where[last] = 1.0
        return where
