"""One gradient step on N tasks from sampled episodes (`eq:adap`, `eq:adaptation`).

The loss is the surrogate -mean over active steps of log pi(a | s) times the normalised advantage
(Williams 1992; Schulman et al. 2016). For the meta-gradient its expectation is differentiated
exactly, through the known models, while the sampling noise of the episodes that were drawn is
added as a constant: the outer objective then sees the step that adaptation will really take.

Online, episodes may be sampled with a uniform part mixed in, so that what a confident policy never
tries is tried. Steps that turned out well count in full, those that turned out badly by how
likely the policy itself would have taken them (tapered off-policy REINFORCE, Le Roux et al.
2025): a good surprise is learned from at once, a bad one is not the policy's fault.

Axes: N tasks, B episodes, T steps, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from merap.learning.advantages import Baseline, advantages, baseline_values, discounted_sums
from merap.learning.exact import ExactProblem, policy_gradient
from merap.learning.policy import Parameters, PolicyNetwork, action_logits, explore, log_policy, policy_table
from merap.learning.rollout import Episodes, Sampler, rollout

# Equal advantages carry nothing but rounding errors; those must not be blown up.
_LEAST_DEVIATION = 1e-3


@dataclass(frozen=True)
class StepRule:
    """How episodes become a step; meanings as in `TrainingConfig`."""

    discount: float
    episodes: int
    baseline: Baseline
    ridge: float
    gae_lambda: float
    variance_prior: float
    noise_episodes: float
    exploration: float

    def length_factor(self, num_episodes: int) -> float:
        """How much shorter a step on fewer episodes is (the noise scale of McCandlish et al. 2018)."""
        noise = self.noise_episodes
        return (1 + noise / self.episodes) / (1 + noise / num_episodes)


@dataclass(frozen=True, eq=False)
class Surrogate:
    """The gradient of the surrogate loss in log pi.

    Attributes:
        gradient: float [N, S, A], of the loss in log pi(a | s).
        scale: float [N], what turns an expected advantage into a term of the loss.
        variance: float [N], of the advantages, before the prior.
    """

    gradient: Tensor
    scale: Tensor
    variance: Tensor


def surrogate(episodes: Episodes, blame: Tensor, rule: StepRule, variance: Tensor | None) -> Surrogate:
    """The gradient from episodes.

    Args:
        episodes: N x B episodes.
        blame: float [N, S, A], weight of a step with a negative advantage.
        rule: how.
        variance: float [], that of the advantages in training; None if not known yet.
    """
    num_tasks, num_states, num_actions = blame.shape
    to_go = discounted_sums(episodes.reward, rule.discount)
    values = baseline_values(episodes, to_go, num_states, rule.baseline, rule.ridge)
    advantage = advantages(episodes, values, rule.discount, rule.gae_lambda)
    weight = episodes.active.to(advantage.dtype)
    count = weight.sum(dim=(1, 2), keepdim=True).clamp_min(1)
    centred = (advantage - advantage.sum(dim=(1, 2), keepdim=True) / count) * weight
    seen = centred.square().sum(dim=(1, 2), keepdim=True) / count
    deviation = (_shrunk(seen, episodes, rule, variance) + _LEAST_DEVIATION**2).sqrt()
    cell = (episodes.state * num_actions + episodes.action).flatten(1)
    normalised = (centred / deviation).flatten(1)
    normalised = torch.where(normalised < 0, normalised * blame.flatten(1).gather(1, cell), normalised)
    summed = torch.zeros(num_tasks, num_states * num_actions, dtype=advantage.dtype)
    summed.scatter_add_(1, cell, normalised)
    steps_per_episode = count.flatten() / episodes.state.shape[1]
    return Surrogate(
        gradient=-(summed / count.flatten(1)).view(blame.shape),
        scale=1 / (deviation.flatten() * steps_per_episode),
        variance=seen.flatten(),
    )


def _shrunk(seen: Tensor, episodes: Episodes, rule: StepRule, variance: Tensor | None) -> Tensor:
    """A few episodes tell little of the variance: they are averaged with what training has seen."""
    if variance is None or rule.variance_prior == 0:
        return seen
    num_episodes = episodes.state.shape[1]
    total = num_episodes * seen + rule.variance_prior * variance
    return total / (num_episodes + rule.variance_prior)


@dataclass(frozen=True, eq=False)
class Stepped:
    """What a step on N tasks leads to.

    Attributes:
        parameters: [N, ...], after the step.
        episodes: what it was made from.
        variance: float [N], of the advantages.
    """

    parameters: Parameters
    episodes: Episodes
    variance: Tensor


def sampled_step(
    network: PolicyNetwork,
    parameters: Parameters,
    step_sizes: Parameters,
    enabled: Tensor,
    episodes: Episodes,
    rule: StepRule,
    variance: Tensor | None,
) -> Stepped:
    """A step from given episodes (`eq:adaptation`).

    Args:
        network: the policy's shape.
        parameters: [N, ...].
        step_sizes: alpha for each parameter, broadcast against it.
        enabled: bool [N, S, A].
        episodes: sampled by `behaviour`.
        rule: how.
        variance: as in `surrogate`.
    """
    leaves = {name: value.detach().requires_grad_() for name, value in parameters.items()}
    log_probs = log_policy(action_logits(network, leaves), enabled)
    found = surrogate(episodes, _blame(log_probs.detach(), enabled, rule), rule, variance)
    directions = torch.autograd.grad(log_probs, list(leaves.values()), found.gradient)
    factor = rule.length_factor(episodes.state.shape[1])
    stepped = {
        name: (value - factor * step_sizes[name] * direction).detach()
        for (name, value), direction in zip(leaves.items(), directions, strict=True)
    }
    return Stepped(stepped, episodes, found.variance)


def behaviour(network: PolicyNetwork, parameters: Parameters, enabled: Tensor, rule: StepRule) -> Tensor:
    """float [N, S, A], the policy that samples episodes online: with the rule's exploration."""
    return explore(policy_table(network, parameters, enabled), enabled, rule.exploration)


def _blame(log_probs: Tensor, enabled: Tensor, rule: StepRule) -> Tensor:
    """How likely the policy itself is to take an action, against how likely it was taken; at most 1."""
    probs = log_probs.exp() * enabled
    taken = explore(probs, enabled, rule.exploration)
    return (probs / taken.clamp_min(torch.finfo(probs.dtype).tiny)).clamp_max(1.0)


def expected_step(
    network: PolicyNetwork,
    parameters: Parameters,
    step_sizes: Parameters,
    enabled: Tensor,
    problem: ExactProblem,
    tasks: Sampler,
    rule: StepRule,
    variance: Tensor | None,
    generator: torch.Generator,
    order: int,
) -> Stepped:
    """A step as `sampled_step`, differentiable in parameters and step sizes.

    Args:
        network: the policy's shape.
        parameters: [N, ...].
        step_sizes: alpha for each parameter, broadcast against it.
        enabled: bool [N, S, A].
        problem: the tasks' exact values.
        tasks: the same tasks for sampling.
        rule: how.
        variance: as in `surrogate`.
        generator: of the episodes whose noise is added.
        order: 1 takes the step's direction as a constant (first-order MAML).
    """
    log_probs = log_policy(action_logits(network, parameters), enabled)
    acting = log_probs.exp() * enabled
    episodes = rollout(acting, tasks, rule.episodes, generator)
    found = surrogate(episodes, torch.ones_like(acting), rule, variance)
    expected = -policy_gradient(acting, problem) * acting * found.scale[:, None, None]
    noise = (found.gradient - expected).detach()
    leaves = list(parameters.values())
    of_noise = torch.autograd.grad(log_probs, leaves, noise, retain_graph=True)
    of_mean = torch.autograd.grad(log_probs, leaves, expected, create_graph=order == 2)
    directions = [one.detach() + other for one, other in zip(of_noise, of_mean, strict=True)]
    stepped = {
        name: value - step_sizes[name] * direction
        for (name, value), direction in zip(parameters.items(), directions, strict=True)
    }
    return Stepped(stepped, episodes, found.variance)
