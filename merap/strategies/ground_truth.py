"""A simulated system as it really is: for scores and reports, never for what manages it.

Axes: S states of an index.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from merap.concerns.combination import Combination
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.index import FamilyIndex, carried
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import optimum
from merap.mdp.reserved_names import UNSAFE_LABEL
from merap.mdp.short_repr import ShortRepr
from merap.shield.safe_optimum import SafeOptimum
from merap.strategies.evaluation import Range, evaluator, reachable_range
from merap.systems.simulated import true_worlds
from merap.systems.world import Values, Worlds

# Models that are kept on an index.
KEPT = 64


@dataclass(frozen=True, eq=False, repr=False)
class GroundTruth(ShortRepr):
    """A simulated system as it really is; a figure that takes time is computed when first asked for.

    Attributes:
        system: the system.
        worlds: its states and steps, slip included.
        threshold: threshold of the shield; None: there is no shield.
        begun: the whole state in which an episode begins; None: as the objective says.
    """

    system: Combination
    worlds: Worlds = field(repr=False)
    threshold: float | None = None
    begun: Values | None = None

    @property
    def horizon(self) -> int:
        """T, steps of an episode."""
        return self.system.objective.horizon

    @cached_property
    def whole(self) -> TabularMDP:
        """The true model, with every variable, of the states that an episode can reach."""
        if self.begun is None:
            return self.worlds.started.model
        world = self.worlds.holding(self.begun)
        initial = np.zeros(world.model.num_states)
        initial[world.number(self.begun)] = 1.0
        return restrict_to_reachable(replace(world.model, initial=initial))

    def model_on(self, index: FamilyIndex) -> TabularMDP:
        """Return the true model on an index that has its states."""
        return _placed(self.whole, index)

    @property
    def declares_unsafe(self) -> bool:
        """Whether the objective says that some states are unsafe."""
        return UNSAFE_LABEL in self.whole.labels

    @cached_property
    def reachable(self) -> Range:
        """Undiscounted returns of the best and the worst time-indexed policy."""
        return reachable_range(self.whole, self.horizon)

    @cached_property
    def discounted_optimum(self) -> float:
        """Discounted return of the best time-indexed policy."""
        return optimum(self.whole, self.horizon, self.system.discount)

    @cached_property
    def safe_optimum(self) -> SafeOptimum | None:
        """Value of the best policies within the threshold, the model known; None: there is no shield."""
        return None if self.threshold is None else SafeOptimum(self.whole, self.horizon, self.threshold)

    def value(self, policy: Floats, index: FamilyIndex) -> float:
        """Return the expected undiscounted return of a policy, uniform where it does not say what to do.

        Args:
            policy: float64 [S, A] or [T, S, A].
            index: S states.
        """
        known = _with_states(self.whole, index)
        table = carried(policy, index, known, 1 / policy.shape[-1])
        return evaluator(_placed(self.whole, known), self.horizon)(table)

    def starting(self, values: Values) -> GroundTruth:
        """Return the same for an episode that begins in a whole state.

        Raises:
            MerapError: no episode can begin there.
        """
        return replace(self, begun=values)


def ground_truth(system: Combination, slip: float = 0.0, threshold: float | None = None) -> GroundTruth:
    """Return the ground truth of a combination, its model made from the definition.

    Args:
        system: the combination.
        slip: probability that an action does nothing.
        threshold: threshold of the shield; None: there is no shield.

    Raises:
        InputError: a reachable state has no action; names it. The probability is not in [0, 1).
    """
    return GroundTruth(system, true_worlds(system, slip), threshold)


@lru_cache(maxsize=KEPT)
def _with_states(whole: TabularMDP, index: FamilyIndex) -> FamilyIndex:
    return index.extended(whole)


@lru_cache(maxsize=KEPT)
def _placed(whole: TabularMDP, index: FamilyIndex) -> TabularMDP:
    return index.place(whole)
