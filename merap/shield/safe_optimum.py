"""What a system allows within a shield's threshold: how much can be earned, and whether its task can be done.

Axes: S states, C choices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.concerns.combination import Combination
from merap.concerns.synthesis import attach, attach_everywhere
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, UNSAFE_LABEL
from merap.shield.constrained import constrained_optimum
from merap.systems.slip import slipping_pair


@dataclass(frozen=True)
class SafeOptimum:
    """Of all policies within the threshold, the true model known.

    Attributes:
        value: the best undiscounted return.
        completed: the largest probability to complete the task, which may be that of another policy.
    """

    value: float
    completed: float


def safe_value(system: Combination, slip: float, threshold: float, place: int | None = None) -> float:
    """The best undiscounted return of all policies within the threshold, the true model known.

    Args:
        system: what is there.
        slip: probability that an action does nothing.
        threshold: on the probability of ever reaching an unsafe state within the horizon.
        place: location p and mode q in which an episode begins, as p * Q + q; None: as the objective says.
    """
    return _value(_whole(system, slip, place), system.objective.horizon, threshold)


def safe_optimum(system: Combination, slip: float, threshold: float) -> SafeOptimum:
    """What is possible; the arguments are those of `safe_value`."""
    whole, horizon = _whole(system, slip, None), system.objective.horizon
    return SafeOptimum(_value(whole, horizon, threshold), _value(_completion(whole), horizon, threshold))


def _whole(system: Combination, slip: float, place: int | None) -> TabularMDP:
    """The whole states: the canonical index does not tell where a task was completed."""
    pair = slipping_pair(system, slip)
    if place is None:
        return attach(pair, system)
    everywhere = attach_everywhere(pair, system)
    initial = np.eye(1, everywhere.num_states, 2 * place)[0]
    return restrict_to_reachable(replace(everywhere, initial=initial))


def _value(whole: TabularMDP, horizon: int, threshold: float) -> float:
    unsafe = whole.labels.get(UNSAFE_LABEL, np.zeros(whole.num_states, dtype=np.bool_))
    return constrained_optimum(whole, unsafe, threshold, horizon)


def _completion(model: TabularMDP) -> TabularMDP:
    """The same with a reward of 1 for completing the task, and no other."""
    done = model.labels[COMPLETE_LABEL]
    reward = np.where(done[model.choice_state], 0.0, model.transitions @ done.astype(np.float64))
    return replace(model, choice_reward=reward, branch_reward=None)
