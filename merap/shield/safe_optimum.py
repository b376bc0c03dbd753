"""The best return, and the best chance to complete the task, within the threshold of a shield.

Axes: S states, C choices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, UNSAFE_LABEL
from merap.shield.constrained import constrained_optimum


@dataclass(frozen=True, eq=False)
class SafeOptimum:
    """The best that policies within a threshold can do, the true model known; computed when asked for.

    Attributes:
        model: the whole model: the index of a case does not tell where a task was completed.
        horizon: T, steps of an episode.
        threshold: on the probability of ever reaching an unsafe state within the horizon.
    """

    model: TabularMDP
    horizon: int
    threshold: float

    @cached_property
    def value(self) -> float:
        """The best undiscounted return."""
        return _value(self.model, self.horizon, self.threshold)

    @cached_property
    def completed(self) -> float:
        """The largest probability to complete the task, which may be that of another policy."""
        return _value(_completion(self.model), self.horizon, self.threshold)


def _value(whole: TabularMDP, horizon: int, threshold: float) -> float:
    unsafe = whole.labels.get(UNSAFE_LABEL, np.zeros(whole.num_states, dtype=np.bool_))
    return constrained_optimum(whole, unsafe, threshold, horizon)


def _completion(model: TabularMDP) -> TabularMDP:
    """Return the model with a reward of 1 for completing the task, and no other."""
    done = model.labels[COMPLETE_LABEL]
    reward = np.where(done[model.choice_state], 0.0, model.transitions @ done.astype(np.float64))
    return replace(model, choice_reward=reward, branch_reward=None)
