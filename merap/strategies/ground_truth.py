"""A simulated system as it really is: for scores and reports, never for what manages it.

Axes: S states of the index of the case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from merap.concerns.combination import Combination
from merap.families.build import canonical
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import optimum
from merap.mdp.reserved_names import UNSAFE_LABEL
from merap.mdp.short_repr import ShortRepr
from merap.shield.safe_optimum import SafeOptimum
from merap.strategies.evaluation import Range, evaluator, reachable_range
from merap.systems.simulated import true_worlds
from merap.systems.world import Values, Worlds


@dataclass(frozen=True, eq=False, repr=False)
class GroundTruth(ShortRepr):
    """A simulated system as it really is; a figure that takes time is computed when first asked for.

    Attributes:
        system: the system.
        worlds: its states and steps, slip included.
        place: puts a whole model on the index of the case.
        threshold: threshold of the shield; None: there is no shield.
        begun: the whole state in which an episode begins; None: as the objective says.
    """

    system: Combination
    worlds: Worlds = field(repr=False)
    place: Callable[[TabularMDP], TabularMDP] = field(repr=False)
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

    @cached_property
    def model(self) -> TabularMDP:
        """The true model on the index of the case."""
        return self.place(self.whole)

    @property
    def declares_unsafe(self) -> bool:
        """Whether the objective says that some states are unsafe."""
        return UNSAFE_LABEL in self.whole.labels

    @cached_property
    def reachable(self) -> Range:
        """Undiscounted returns of the best and the worst time-indexed policy."""
        return reachable_range(self.model, self.horizon)

    @cached_property
    def discounted_optimum(self) -> float:
        """Discounted return of the best time-indexed policy."""
        return optimum(self.model, self.horizon, self.system.discount)

    @cached_property
    def safe_optimum(self) -> SafeOptimum | None:
        """Value of the best policies within the threshold, the model known; None: there is no shield."""
        return None if self.threshold is None else SafeOptimum(self.whole, self.horizon, self.threshold)

    def value(self, policy: Floats) -> float:
        """Return the expected undiscounted return of a policy, float64 [S, A] or [T, S, A]."""
        return evaluator(self.model, self.horizon)(policy)

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
    worlds = true_worlds(system, slip)
    return GroundTruth(system, worlds, lambda whole: canonical(system, whole), threshold)
