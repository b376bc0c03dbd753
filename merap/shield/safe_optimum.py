"""The best return, and the best chance to complete the task, within the threshold of a shield.

Axes: S states, C choices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.synthesis import attach, attach_everywhere
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, UNSAFE_LABEL
from merap.shield.constrained import constrained_optimum
from merap.systems.slip import slipping_pair


@dataclass(frozen=True, eq=False)
class SafeOptimum:
    """The best that policies within a threshold can do, the true model known; computed when asked for.

    Attributes:
        system: the system.
        slip: probability that an action does nothing.
        threshold: on the probability of ever reaching an unsafe state within the horizon.
        place: location p and mode q in which an episode begins, as p * Q + q; None: as the objective says.
    """

    system: DeclaredCombination
    slip: float
    threshold: float
    place: int | None = None

    @cached_property
    def value(self) -> float:
        """The best undiscounted return."""
        return _value(self._whole, self.system.objective.horizon, self.threshold)

    @cached_property
    def completed(self) -> float:
        """The largest probability to complete the task, which may be that of another policy."""
        return _value(_completion(self._whole), self.system.objective.horizon, self.threshold)

    @cached_property
    def _whole(self) -> TabularMDP:
        """The whole states: the canonical index does not tell where a task was completed."""
        pair = slipping_pair(self.system, self.slip)
        if self.place is None:
            return attach(pair, self.system)
        everywhere = attach_everywhere(pair, self.system)
        initial = np.eye(1, everywhere.num_states, 2 * self.place)[0]
        return restrict_to_reachable(replace(everywhere, initial=initial))


def _value(whole: TabularMDP, horizon: int, threshold: float) -> float:
    unsafe = whole.labels.get(UNSAFE_LABEL, np.zeros(whole.num_states, dtype=np.bool_))
    return constrained_optimum(whole, unsafe, threshold, horizon)


def _completion(model: TabularMDP) -> TabularMDP:
    """Return the model with a reward of 1 for completing the task, and no other."""
    done = model.labels[COMPLETE_LABEL]
    reward = np.where(done[model.choice_state], 0.0, model.transitions @ done.astype(np.float64))
    return replace(model, choice_reward=reward, branch_reward=None)
