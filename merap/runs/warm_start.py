"""Training that begins where another run has ended, as for a case that was extended."""

from __future__ import annotations

import torch

from merap.errors import InputError
from merap.families.build import ModelBase
from merap.learning.config import TrainingConfig
from merap.learning.meta import MetaPolicy, carried_over
from merap.learning.policy import flat
from merap.learning.tasks import TaskBatch
from merap.learning.training import TrainingState, initial_state, policy_network
from merap.runs.policy_on_index import on_index

# What says which policy a configuration has: another run's parameters fit no other.
NETWORK_SETTINGS = ("observation", "hidden", "activation")


def fitted(
    meta: MetaPolicy, before: ModelBase, base: ModelBase, tasks: TaskBatch, config: TrainingConfig
) -> MetaPolicy:
    """Return a policy of one base for another one, to begin with.

    Args:
        meta: what was learned.
        before: of this base.
        base: that is to be learned.
        tasks: the same as arrays.
        config: of the new run.

    Raises:
        InputError: actions, states, features or the network are others; says which.
    """
    if base.index.actions != before.index.actions:
        known, wanted = (", ".join(one.index.actions) for one in (before, base))
        raise InputError(f"the policy chooses among {known}; the case has {wanted}")
    network = policy_network(tasks, config)
    if (network.hidden, network.activation, network.features is None) != (
        meta.network.hidden,
        meta.network.activation,
        meta.network.features is None,
    ):
        raise InputError(
            f"the settings {', '.join(NETWORK_SETTINGS)} must be those that the policy was learned with"
        )
    if network.features is not None:
        return carried_over(meta, tasks)
    if base.kinds != before.kinds:
        raise InputError(
            "the policy observes one-hot states, and those of the case are others; "
            "train with observation=factored for cases with other states"
        )
    return on_index(meta, before.index, base.index)


def begun_from(meta: MetaPolicy, tasks: TaskBatch, config: TrainingConfig) -> TrainingState:
    """Return the state before the first update: parameters and step sizes are those of a meta policy."""
    state = initial_state(policy_network(tasks, config), config, tasks.dtype)
    sizes = torch.cat([value.flatten() for value in meta.step_sizes.values()])
    with torch.no_grad():
        state.theta.copy_(flat(meta.parameters))
        state.log_step_sizes.copy_(sizes.log())
    state.variance = meta.variance.clone()
    return state
