"""A policy on models of another size: the same parameters, observing other states."""

from __future__ import annotations

from dataclasses import replace

from merap.errors import InputError
from merap.learning.meta import MetaPolicy
from merap.learning.tasks import TaskBatch


def carried_over(meta: MetaPolicy, tasks: TaskBatch) -> MetaPolicy:
    """A meta policy as it acts on other models than it was trained on.

    Args:
        meta: trained with the factored observation, or on models with as many states.
        tasks: the other models.

    Raises:
        InputError: parameters for these models would have another shape; says which.
    """
    network = meta.network
    if tasks.num_actions != network.num_actions:
        raise InputError(
            f"the policy chooses among {network.num_actions} actions, the models have {tasks.num_actions}"
        )
    if network.features is None:
        if tasks.num_states != network.num_states:
            raise InputError(
                f"the policy observes {network.num_states} states one-hot, the models have "
                f"{tasks.num_states}; train with observation=factored for models of several sizes"
            )
        return meta
    assert tasks.features is not None, "tasks without features"
    if tasks.features.shape[1] != network.features.shape[1]:
        raise InputError(
            f"the policy observes {network.features.shape[1]} features, the models have "
            f"{tasks.features.shape[1]}: they have other variables, or categories of another number"
        )
    seen = replace(network, num_states=tasks.num_states, features=tasks.features)
    return replace(meta, network=seen)
