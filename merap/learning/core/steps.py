"""Inner gradient steps (`eq:adap`) and their derivatives.

The sampled estimator's inner loss is L = sum weight(s, a) log pi(a | s) with what episodes say as
weights. The exact one's is L = sum weight(s, a) z(s, a) - scale J(pi) with the logits z: the second part is
the step's expectation, and the first the sampling noise of episodes that were drawn, so that the outer
objective sees the step that adaptation will really take and still differentiates its expectation. Noise
is held as weights of the logits, since there it has mean 0. (As weights of log pi it has not: what a
baseline adds there has no gradient, but a curvature.)

A step is theta' = theta - alpha dL/dtheta with dtheta'/dtheta = 1 - alpha H. Products with this matrix are
made of products of the Hessian H with a direction; H is never stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from merap.learning.core.jit import Array, compiled
from merap.learning.core.network import (
    Cotangents,
    Network,
    Signals,
    forward,
    pullback,
    pullback_dot,
    pushforward,
)
from merap.learning.core.softmax import (
    less_expected,
    masked_softmax,
    through_log_softmax,
    through_softmax,
    through_softmax_dot,
)
from merap.learning.core.task import Tasks
from merap.learning.core.values import Values, hessian_product, values


class Policies(NamedTuple):
    """A network's policies on N tasks.

    Attributes:
        theta: float [P], one row for all tasks, or [N, P].
        at: the network's signals.
        table: float [N, S, A], probabilities.
    """

    theta: Array
    at: Signals
    table: Array


class Loss(NamedTuple):
    """What an inner step descends.

    Attributes:
        weight: float [N, S, A], of log pi, or of the logits beside an exact return; 0 where an
            action is disabled.
        scale: float [N], of the exact return; None leaves it out.
    """

    weight: Array
    scale: Array | None


class Step(NamedTuple):
    """One step of N tasks.

    Attributes:
        before: the policies it starts from.
        loss: what it descends.
        found: their exact returns; None if the loss leaves them out.
        gradient: float [N, P], of the loss.
        cotangents: of `pullback`.
    """

    before: Policies
    loss: Loss
    found: Values | None
    gradient: Array
    cotangents: Cotangents


def policies(theta: Array, network: Network, tasks: Tasks) -> Policies:
    """The policies of parameters."""
    at = forward(theta, network)
    return Policies(theta, at, masked_softmax(at.logits, tasks.enabled))


def step_from(before: Policies, loss: Loss, found: Values | None, network: Network) -> Step:
    """The gradient of a loss; `found` is the worth of these policies, if the loss needs it."""
    if found is not None and loss.scale is not None:
        slope = less_expected(before.table, loss.weight, loss.scale, found.gradient)
    else:
        slope = through_log_softmax(before.table, loss.weight)
    return Step(before, loss, found, *pullback(before.theta, network, before.at, slope))


def step_again(before: Policies, loss: Loss, network: Network, tasks: Tasks, horizon: int) -> Step:
    """The step of a loss that was drawn before, from other parameters."""
    found = None if loss.scale is None else values(before.table, tasks, horizon)
    return step_from(before, loss, found, network)


def stepped(step: Step, step_sizes: Array) -> Array:
    """theta' [N, P], by step sizes alpha [P]."""
    return _less(np.atleast_2d(step.before.theta), step_sizes, step.gradient)


def push(steps: Sequence[Step], direction: Array, step_sizes: Array, network: Network, tasks: Tasks) -> Array:
    """dtheta'/dtheta times a direction [1, P], through all steps; [N, P]."""
    for step in steps:
        direction = direction - step_sizes * _hessian_times(step, direction, network, tasks)
    return direction


def pull(
    steps: Sequence[Step], cotangent: Array, step_sizes: Array, network: Network, tasks: Tasks, order: int
) -> tuple[Array, Array]:
    """A gradient in theta' [N, P] as one in theta, and its slope in log alpha.

    Args:
        steps: from theta, which all tasks share, to theta'.
        cotangent: float [N, P], the gradient in theta'.
        step_sizes: float [P], alpha.
        network: the policies' shape.
        tasks: N of them.
        order: 1 takes the steps' directions as constants (first-order MAML).

    Returns:
        float [P] both, summed over the tasks: in theta, and in each entry's log alpha.
    """
    of_sizes: Array = np.zeros_like(step_sizes)
    for step in reversed(steps):
        moved, total, slopes = _moved(cotangent, step.gradient, step_sizes)
        of_sizes -= slopes
        summed = step is steps[0]
        if summed:
            cotangent = total
        if order == 2:
            cotangent = cotangent - _hessian_times(step, moved, network, tasks, summed=summed)
    return cotangent, of_sizes


@compiled
def _less(theta: Array, step_sizes: Array, gradient: Array) -> Array:
    """theta [1, P] or [N, P] less alpha times a gradient [N, P]."""
    result = np.empty_like(gradient)
    num_tasks, num_entries = gradient.shape
    for n in range(num_tasks):
        r = n if len(theta) > 1 else 0
        for p in range(num_entries):
            result[n, p] = theta[r, p] - step_sizes[p] * gradient[n, p]
    return result


@compiled
def _moved(cotangent: Array, gradient: Array, step_sizes: Array) -> tuple[Array, Array, Array]:
    """alpha times a cotangent [N, P]; sums over the tasks: of the cotangent, and of that times a gradient."""
    moved = np.empty_like(cotangent)
    total, slopes = np.zeros_like(step_sizes), np.zeros_like(step_sizes)
    num_tasks, num_entries = cotangent.shape
    for n in range(num_tasks):
        for p in range(num_entries):
            moved[n, p] = step_sizes[p] * cotangent[n, p]
            total[p] += cotangent[n, p]
            slopes[p] += moved[n, p] * gradient[n, p]
    return moved, total, slopes


def _hessian_times(
    step: Step, direction: Array, network: Network, tasks: Tasks, *, summed: bool = False
) -> Array:
    """H times a direction [N, P]; summed over the tasks, if they share the parameters."""
    before = step.before
    tangent = pushforward(before.theta, network, before.at, direction)
    logits_dot = np.ascontiguousarray(np.broadcast_to(tangent.logits, before.table.shape))
    slope_dot = _slope_dot(step, logits_dot, tasks)
    return pullback_dot(
        before.theta, network, before.at, step.cotangents, direction, tangent, slope_dot, summed=summed
    )


def _slope_dot(step: Step, logits_dot: Array, tasks: Tasks) -> Array:
    """The derivative of dL/dlogits along a direction of the logits [N, S, A]."""
    table, loss = step.before.table, step.loss
    table_dot = through_softmax(table, logits_dot)
    if step.found is not None and loss.scale is not None:
        gradient_dot = hessian_product(table, step.found, table_dot, tasks)
        gradient = step.found.gradient
        return through_softmax_dot(table, table_dot, gradient, gradient_dot, -loss.scale)
    slope_dot: Array = -table_dot * loss.weight.sum(axis=-1, keepdims=True)
    return slope_dot
