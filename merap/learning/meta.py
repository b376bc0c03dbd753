"""The meta policy and its outer objective (`eq:mrl2`, `eq:meta-opt`).

Axes: N tasks, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.exact import ExactProblem, exact_problem, expected_return
from merap.learning.gradient_step import StepRule, expected_step
from merap.learning.policy import (
    Parameters,
    PolicyNetwork,
    action_logits,
    log_policy,
    policy_table,
    stack_parameters,
)
from merap.learning.rollout import Episodes, Sampler, sampler
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


@dataclass(frozen=True, eq=False)
class Batch:
    """Tasks of one update in the layouts that it needs."""

    tasks: TaskBatch
    problem: ExactProblem
    sampler: Sampler


def batch(tasks: TaskBatch) -> Batch:
    """Lay out tasks for an update."""
    return Batch(tasks, exact_problem(tasks), sampler(tasks))


@dataclass(frozen=True, eq=False)
class Objective:
    """The outer objective on a batch.

    Attributes:
        adapted_return: float [], mean expected discounted return of the adapted policies;
            differentiable.
        meta_return: float [], that of the meta policy itself.
        entropy: float [], mean entropy of the meta policy over the steps of its episodes;
            differentiable.
        variance: float [], mean of the advantages' variance.
    """

    adapted_return: Tensor
    meta_return: Tensor
    entropy: Tensor
    variance: Tensor


def step_rule(config: TrainingConfig, discount: float) -> StepRule:
    """The rule that a configuration describes."""
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


def objective(
    network: PolicyNetwork,
    parameters: Parameters,
    log_step_sizes: Parameters,
    variance: Tensor | None,
    tasks: Batch,
    config: TrainingConfig,
    generator: torch.Generator,
) -> Objective:
    """Adapt to every task by inner steps and evaluate exactly (Finn et al. 2017, algorithm 3).

    Args:
        network: the policy's shape.
        parameters: theta, the meta policy.
        log_step_sizes: log alpha for each of them.
        variance: float [], of the advantages so far; None at the first update.
        tasks: a batch.
        config: inner steps, order, and the rule.
        generator: of the episodes whose noise the inner steps carry.
    """
    rule = step_rule(config, tasks.tasks.discount)
    enabled = tasks.tasks.enabled
    step_sizes = {name: value.exp() for name, value in log_step_sizes.items()}
    adapted = stack_parameters(parameters, tasks.tasks.num_tasks)
    with torch.no_grad():
        before = expected_return(policy_table(network, adapted, enabled), tasks.problem).mean()
    seen, episodes = [], None
    for _ in range(config.inner_steps):
        stepped = expected_step(
            network,
            adapted,
            step_sizes,
            enabled,
            tasks.problem,
            tasks.sampler,
            rule,
            variance,
            generator,
            config.order,
        )
        adapted = stepped.parameters
        seen.append(stepped.variance.mean())
        episodes = stepped.episodes if episodes is None else episodes
    assert episodes is not None
    after = expected_return(policy_table(network, adapted, enabled), tasks.problem).mean()
    entropy = _entropy(network, parameters, enabled, episodes)
    return Objective(after, before, entropy, torch.stack(seen).mean())


def _entropy(network: PolicyNetwork, parameters: Parameters, enabled: Tensor, episodes: Episodes) -> Tensor:
    log_probs = log_policy(action_logits(network, parameters), enabled)
    of_states = -(log_probs.exp() * log_probs * enabled).sum(dim=-1)
    of_steps = of_states.gather(1, episodes.state.flatten(1)) * episodes.active.flatten(1)
    return of_steps.sum() / episodes.active.sum()
