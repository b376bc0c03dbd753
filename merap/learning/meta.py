"""What training learns: the meta policy, how its steps are taken, and how it acts on other models."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from merap.errors import InputError
from merap.learning.config import TrainingConfig
from merap.learning.gradient_step import StepRule
from merap.learning.policy import Parameters, PolicyNetwork
from merap.learning.tasks import TaskBatch


@dataclass(frozen=True, eq=False)
class MetaPolicy:
    """What training learns: where adaptation starts, and how far its steps go.

    Attributes:
        network: the policy's shape.
        parameters: theta.
        step_sizes: alpha for each of them, learned (Li et al. 2017, Meta-SGD), one number per
            weight or bias.
        variance: float [], of the advantages in training.
        rule: how episodes become a step.
    """

    network: PolicyNetwork
    parameters: Parameters
    step_sizes: Parameters
    variance: Tensor
    rule: StepRule


def step_rule(config: TrainingConfig, discount: float) -> StepRule:
    """Return the rule that a configuration describes."""
    return StepRule(
        discount=discount,
        episodes=config.episodes,
        baseline=config.baseline,
        ridge=config.ridge,
        gae_lambda=config.gae_lambda,
        variance_prior=config.variance_prior,
        noise_episodes=config.noise_episodes,
        exploration=config.exploration,
    )


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
