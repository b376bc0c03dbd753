"""One gradient step on N tasks from sampled episodes (`eq:adap`, `eq:adaptation`).

The loss is the surrogate -mean over active steps of log pi(a | s) times the normalised advantage
(Williams 1992; Schulman et al. 2016).

Online, episodes may be sampled with a uniform part mixed in, so that what a confident policy never
tries is tried. Steps that turned out well count in full, those that turned out badly by how
likely the policy itself would have taken them (tapered off-policy REINFORCE, Le Roux et al.
2025): a good surprise is learned from at once, a bad one is not the policy's fault.

Axes: N tasks, B episodes, T steps, S states, A actions, P parameters in one row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from merap.learning.config import Baseline
from merap.learning.episodes import Episodes
from merap.learning.policy import Parameters, PolicyNetwork, action_logits, explore, log_policy, policy_table
from merap.learning.surrogate import AdvantageRule, surrogate


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

    def advantage_rule(self, variance: Tensor | None) -> AdvantageRule:
        """Return how advantages are made.

        Args:
            variance: float [], of the advantages in training; None if not known yet. A few episodes
                tell little of it: they are averaged with what training has seen.
        """
        return AdvantageRule(
            discount=self.discount,
            gae_lambda=self.gae_lambda,
            baseline=self.baseline,
            ridge=self.ridge,
            variance=0.0 if variance is None else variance.item(),
            variance_weight=0.0 if variance is None else self.variance_prior,
        )


@dataclass(frozen=True, eq=False)
class Stepped:
    """What a step on N tasks leads to.

    Attributes:
        parameters: [N, ...], after the step.
        variance: float [N], of the advantages.
    """

    parameters: Parameters
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
        step_sizes: alpha for each parameter, one number each.
        enabled: bool [N, S, A].
        episodes: sampled by `behaviour`.
        rule: how.
        variance: float [], of the advantages in training; None if not known yet.
    """
    with torch.enable_grad():
        leaves = {name: value.detach().requires_grad_() for name, value in parameters.items()}
        log_probs = log_policy(action_logits(network, leaves), enabled)
        policy = log_probs.detach().exp() * enabled
        blame = _blame(policy, enabled, rule.exploration)
        found = surrogate(episodes, rule.advantage_rule(variance), policy.shape, blame)
        gradients = pullback(log_probs, found.gradient, tuple(leaves.values()), graph=False)
    length = rule.length_factor(episodes.state.shape[1])
    moved = {
        name: value.detach() - length * step_sizes[name].flatten()[0] * gradient
        for (name, value), gradient in zip(parameters.items(), gradients, strict=True)
    }
    return Stepped(moved, found.variance.to(policy.dtype))


def _blame(policy: Tensor, enabled: Tensor, exploration: float) -> Tensor:
    """How likely the policy is to take an action, against how likely it was taken; at most 1; [N, S, A]."""
    taken = explore(policy, enabled, exploration)
    return (policy / taken.clamp_min(torch.finfo(policy.dtype).tiny)).clamp_max(1.0)


def behaviour(network: PolicyNetwork, parameters: Parameters, enabled: Tensor, rule: StepRule) -> Tensor:
    """float [N, S, A], the policy that samples episodes online: with the rule's exploration."""
    return explore(policy_table(network, parameters, enabled), enabled, rule.exploration)


def pullback(output: Tensor, slope: Tensor, inputs: Sequence[Tensor], *, graph: bool) -> tuple[Tensor, ...]:
    """Return the gradients in inputs of a scalar that has a slope in an output of theirs.

    With a graph they can be differentiated, also through the slope. It comes in by a hook: as `grad_outputs`
    it would make torch import its compiler's shapes, and sympy, for a second and a half.
    """
    hook = output.register_hook(lambda ones: slope)  # type: ignore[no-untyped-call]
    gradients = torch.autograd.grad(output.sum(), inputs, create_graph=graph)
    hook.remove()
    return gradients
