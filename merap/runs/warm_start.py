"""Training that begins where another run has ended, as for a case that was extended."""

from __future__ import annotations

import numpy as np
import torch

from merap.concerns.case_study import CaseStudy
from merap.concerns.synthesis import pair_valuations
from merap.errors import InputError
from merap.learning.config import TrainingConfig
from merap.learning.meta import MetaPolicy, carried_over
from merap.learning.policy import flat
from merap.learning.tasks import TaskBatch
from merap.learning.training import TrainingState, initial_state, policy_network

# What says which policy a configuration has: another run's parameters fit no other.
NETWORK_SETTINGS = ("observation", "hidden", "activation")


def require_fit(
    meta: MetaPolicy, before: CaseStudy, case: CaseStudy, tasks: TaskBatch, config: TrainingConfig
) -> None:
    """Refuse a start that means something else in another case.

    Args:
        meta: what was learned.
        before: for this case.
        case: that is to be learned.
        tasks: of its base.
        config: of the new run.

    Raises:
        InputError: actions, states, features or the network are others; says which.
    """
    if case.actions != before.actions:
        raise InputError(
            f"the policy chooses among {', '.join(before.actions)}; the case has {', '.join(case.actions)}"
        )
    wanted = policy_network(tasks, config)
    if (wanted.hidden, wanted.activation, wanted.features is None) != (
        meta.network.hidden,
        meta.network.activation,
        meta.network.features is None,
    ):
        raise InputError(
            f"the settings {', '.join(NETWORK_SETTINGS)} must be those that the policy was learned with"
        )
    if wanted.features is None and not np.array_equal(_states(before), _states(case)):
        raise InputError(
            "the policy observes one-hot states, and those of the case are others; "
            "train with observation=factored for cases with other states"
        )
    carried_over(meta, tasks)


def _states(case: CaseStudy) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    return pair_valuations(case.combination_at(0))


def begun_from(meta: MetaPolicy, tasks: TaskBatch, config: TrainingConfig) -> TrainingState:
    """Return the state before the first update: parameters and step sizes are those of a meta policy."""
    state = initial_state(policy_network(tasks, config), config, tasks.dtype)
    sizes = torch.cat([value.flatten() for value in meta.step_sizes.values()])
    with torch.no_grad():
        state.theta.copy_(flat(meta.parameters))
        state.log_step_sizes.copy_(sizes.log())
    state.variance = meta.variance.clone()
    return state
