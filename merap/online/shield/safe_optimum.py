"""What a system allows within a shield's threshold: how much can be earned, and whether its task can be done.

Axes: S states, C choices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.concerns.combination import Combination
from merap.concerns.synthesis import attach
from merap.mdp.model import TabularMDP
from merap.online.managed.slip import slipping_pair
from merap.online.shield.constrained import constrained_optimum
from merap.online.shield.models import UNSAFE_LABEL

DONE_LABEL = "done"


@dataclass(frozen=True)
class SafeOptimum:
    """Of all policies within the threshold, the true model known.

    Attributes:
        value: the best undiscounted return.
        completed: the largest probability to complete the task, which may be that of another policy.
    """

    value: float
    completed: float


def safe_optimum(system: Combination, slip: float, threshold: float) -> SafeOptimum:
    """What is possible on the whole states: the canonical index does not tell where a task was completed.

    Args:
        system: what is there.
        slip: probability that an action does nothing.
        threshold: on the probability of ever reaching an unsafe state within the horizon.
    """
    whole = attach(slipping_pair(system, slip), system)
    unsafe = whole.labels.get(UNSAFE_LABEL, np.zeros(whole.num_states, dtype=np.bool_))
    horizon = system.objective.horizon
    return SafeOptimum(
        constrained_optimum(whole, unsafe, threshold, horizon),
        constrained_optimum(_completion(whole), unsafe, threshold, horizon),
    )


def _completion(model: TabularMDP) -> TabularMDP:
    """The same with a reward of 1 for completing the task, and no other."""
    done = model.labels[DONE_LABEL]
    reward = np.where(done[model.choice_state], 0.0, model.transitions @ done.astype(np.float64))
    return replace(model, choice_reward=reward, branch_reward=None)
