"""A simulated system as it really is: for scores and reports, never for what manages it.

Axes: S states of the canonical index (the completed state is the last), P locations, Q modes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from merap.concerns.combination import Combination
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.mdp.planning import optimum
from merap.mdp.short_repr import ShortRepr
from merap.shield.safe_optimum import SafeOptimum
from merap.shield.supervision import unsafe_of
from merap.strategies.evaluation import Range, evaluator, reachable_range
from merap.systems.slip import slipping_model


@dataclass(frozen=True, eq=False, repr=False)
class GroundTruth(ShortRepr):
    """A simulated system as it really is; a figure that takes time is computed when first asked for.

    Attributes:
        system: the system.
        model: its true model on the canonical index, slip included.
        slip: probability that an action does nothing.
        threshold: threshold of the shield; None: there is no shield.
        place: location p and mode q in which an episode begins, as p * Q + q; None: as the objective says.
    """

    system: Combination
    model: TabularMDP = field(repr=False)
    slip: float = 0.0
    threshold: float | None = None
    place: int | None = None

    @property
    def horizon(self) -> int:
        """T, steps of an episode."""
        return self.system.objective.horizon

    @cached_property
    def reachable(self) -> Range:
        """Undiscounted returns of the best and the worst time-indexed policy."""
        return reachable_range(self.model, self.horizon)

    @cached_property
    def discounted_optimum(self) -> float:
        """Discounted return of the best time-indexed policy."""
        return optimum(self.model, self.horizon, self.system.discount)

    @cached_property
    def unsafe(self) -> Bools:
        """bool [P * Q], by location and mode: unsafe by the system's objective."""
        declared = unsafe_of(self.system)
        return np.zeros(self.model.num_states - 1, dtype=np.bool_) if declared is None else declared

    @cached_property
    def safe_optimum(self) -> SafeOptimum | None:
        """Value of the best policies within the threshold, the model known; None: there is no shield."""
        if self.threshold is None:
            return None
        return SafeOptimum(self.system, self.slip, self.threshold, self.place)

    def value(self, policy: Floats) -> float:
        """Return the expected undiscounted return of a policy, float64 [S, A] or [T, S, A]."""
        return evaluator(self.model, self.horizon)(policy)

    def starting(self, place: int) -> GroundTruth:
        """Return the same for an episode that begins in location p and mode q, `place` being p * Q + q."""
        initial = np.eye(1, self.model.num_states, place)[0]
        return replace(self, model=replace(self.model, initial=initial), place=place)


def ground_truth(system: Combination, slip: float = 0.0, threshold: float | None = None) -> GroundTruth:
    """Return the ground truth of a combination, its model made from the definition.

    Args:
        system: the combination.
        slip: probability that an action does nothing.
        threshold: threshold of the shield; None: there is no shield.

    Raises:
        InputError: a reachable state has no action; names it. The probability is not in [0, 1).
    """
    return GroundTruth(system, slipping_model(system, slip), slip, threshold)
