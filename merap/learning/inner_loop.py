"""Inner gradient steps (`eq:adap`) from a meta policy to policies of tasks.

The sampled estimator's inner loss is L = sum weight(s, a) log pi(a | s) with weights that episodes give.
The exact one's is L = sum weight(s, a) z(s, a) - scale J(pi) with the logits z: the second part is
the step's expectation, and the first the sampling noise of episodes that were drawn, so that the outer
objective sees the step that adaptation will really take and still differentiates its expectation. Noise
is held as weights of the logits, since there it has mean 0. (As weights of log pi it has not: what a
baseline adds there has no gradient, but a curvature.)

A step is theta' = theta - alpha dL/dtheta, and torch differentiates through it. The loss's slope in the
logits is written down, weight - pi sum weight or weight - scale pi (g - sum pi g) with g = dJ/dpi: that saves
the second derivative of a softmax.

Axes: N tasks, S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from merap.learning.config import Span
from merap.learning.exact import Evaluation, expected_return, return_gradient
from merap.learning.gradient_step import pullback
from merap.learning.policy import (
    DISABLED_LOGIT,
    Parameters,
    PolicyNetwork,
    action_logits,
    softmax,
    stack_parameters,
)
from merap.learning.surrogate import Surrogate
from merap.learning.tasks import TaskBatch


class Loss(NamedTuple):
    """The loss of an inner step.

    Attributes:
        weight: float [N, S, A], of log pi, or of the logits beside an exact return; 0 where an
            action is disabled.
        scale: float [N], of the exact return; None leaves it out.
    """

    weight: Tensor
    scale: Tensor | None


# The loss of policies [N, S, A], and their exact returns if they were worked out for it.
LossOf = Callable[[Tensor], tuple[Loss, Evaluation | None]]


def given(losses: Sequence[Loss]) -> list[LossOf]:
    """Return losses that were drawn before as losses of whatever policy."""
    return [lambda policy, loss=loss: (loss, None) for loss in losses]  # type: ignore[misc]


@dataclass(frozen=True, eq=False)
class InnerLoop:
    """Adaptation of a policy to N tasks.

    Attributes:
        network: the policies' shape.
        enabled: bool [N, S, A].
        tasks: the models; None where only some of their states count.
        span: of exact returns.
        order: 2 differentiates through the steps; 1 takes their directions as constants.
    """

    network: PolicyNetwork
    enabled: Tensor
    tasks: TaskBatch | None
    span: Span
    order: int

    @property
    def num_tasks(self) -> int:
        """N."""
        return len(self.enabled)

    @property
    def known(self) -> TaskBatch:
        """The models."""
        assert self.tasks is not None, "only some states are known"
        return self.tasks

    @cached_property
    def mask(self) -> Tensor:
        """float [N, S, A], added to logits: 0, or about minus infinity where an action is disabled."""
        return torch.where(self.enabled, 0.0, DISABLED_LOGIT)

    def policy(self, parameters: Parameters) -> Tensor:
        """float [N, S, A], of parameters with or without the axis N.

        Where no action is enabled the policy means nothing.
        """
        return softmax(action_logits(self.network, parameters) + self.mask)

    def returns(self, policy: Tensor) -> Tensor:
        """float [N], exact returns of policies [N, S, A]."""
        return expected_return(policy, self.known, self.span)

    def adapt(
        self,
        theta: Parameters,
        step_sizes: Sequence[Tensor],
        losses: Sequence[LossOf],
        *,
        graph: bool = False,
    ) -> Parameters:
        """Take a step down each loss.

        Args:
            theta: the meta policy's, without the axis N.
            step_sizes: alpha, float [] for each of them.
            losses: of the steps; each is asked for when its step's policies are known.
            graph: whether the result can be differentiated in theta and alpha.

        Returns:
            Parameters [N, ...].
        """
        parameters, second = stack_parameters(theta, self.num_tasks), graph and self.order == 2
        with torch.enable_grad():
            for loss_of in losses:
                if not graph:
                    parameters = {name: value.detach().requires_grad_() for name, value in parameters.items()}
                logits = action_logits(self.network, parameters)
                with torch.set_grad_enabled(second):
                    slope = self._slope(softmax(logits + self.mask), loss_of)
                gradients = pullback(logits, slope, tuple(parameters.values()), graph=second)
                parameters = {
                    name: torch.addcmul(value, size, gradient, value=-1)
                    for (name, value), size, gradient in zip(
                        parameters.items(), step_sizes, gradients, strict=True
                    )
                }
        return parameters if graph else {name: value.detach() for name, value in parameters.items()}

    def _slope(self, policy: Tensor, loss_of: LossOf) -> Tensor:
        """float [N, S, A], the gradient of a loss in the logits of policies [N, S, A]."""
        loss, known = loss_of(policy.detach())
        if loss.scale is None:
            return through_log_softmax(policy, loss.weight)
        rise = through_softmax(policy, return_gradient(policy, self.known, self.span, known))
        return torch.addcmul(loss.weight, loss.scale[:, None, None], rise, value=-1)


def exact_loss(policy: Tensor, found: Surrogate, known: Evaluation, *, noise: bool) -> Loss:
    """Return the loss of the episodes of policies [N, S, A] whose exact returns are known.

    With noise their sampling noise stays: the episodes' loss without its expectation.
    """
    if not noise:
        return Loss(torch.zeros_like(policy), found.scale)
    sampled = through_log_softmax(policy, found.gradient)
    expected = through_softmax(policy, known.gradient)
    return Loss(torch.addcmul(sampled, found.scale[:, None, None], expected), found.scale)


def through_softmax(policy: Tensor, gradient: Tensor) -> Tensor:
    """Turn a gradient in pi into one in the logits, or d logits into d pi: that map is symmetric."""
    return policy * (gradient - (policy * gradient).sum(dim=-1, keepdim=True))


def through_log_softmax(policy: Tensor, gradient: Tensor) -> Tensor:
    """Turn a gradient in log pi, 0 where an action is disabled, into one in the logits."""
    return gradient - policy * gradient.sum(dim=-1, keepdim=True)
