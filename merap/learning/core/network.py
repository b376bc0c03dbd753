"""Derivatives of a policy network written out: gradients, directional derivatives, and both.

For a scalar loss L of the logits z(theta) with gradient c = dL/dz, `pullback` gives c' dz/dtheta,
`pushforward` gives dz/dtheta u, and `pullback_dot` the derivative of the former along u, which is a
product of L's Hessian with u (Pearlmutter 1994).

Parameters stand in one row: weight [inputs, outputs] and bias [outputs] of each layer in turn; there is
one row [P] for all tasks, or [N, P]. Cotangents have the axis N. Where all tasks share the parameters and
only the sum over them counts, it is taken before it is spread.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Literal, NamedTuple

import numpy as np

from merap.learning.core import passes
from merap.learning.core.jit import Array, Numbers

Activation = Literal["relu", "tanh", "softplus"]


@dataclass(frozen=True, eq=False)
class Network:
    """The shape of a policy.

    Attributes:
        sizes: of the observation and of what comes out of each layer.
        features: float [S, F], the observation of each state; None if it is the state, one-hot.
        activation: between the layers.
    """

    sizes: tuple[int, ...]
    features: Array | None
    activation: Activation

    @cached_property
    def layers(self) -> Numbers:
        """int64 [L + 1], the sizes as the passes read them."""
        return np.array(self.sizes)

    @cached_property
    def kind(self) -> int:
        """The activation as the passes read it."""
        return {"relu": passes.RELU, "tanh": passes.TANH, "softplus": passes.SOFTPLUS}[self.activation]

    def observed(self, like: Array) -> Array:
        """Features as the passes read them, of the precision of another array."""
        return np.empty((0, 0), dtype=like.dtype) if self.features is None else self.features

    @cached_property
    def bounds(self) -> tuple[tuple[int, int, int], ...]:
        """Where each layer's weight begins, where its bias does, and where that ends."""
        ends = accumulate((inputs + 1) * outputs for inputs, outputs in pairwise(self.sizes))
        return tuple(
            (end - (inputs + 1) * outputs, end - outputs, end)
            for end, (inputs, outputs) in zip(ends, pairwise(self.sizes), strict=True)
        )


class Signals(NamedTuple):
    """What a network does in all states; R rows of parameters, U hidden units.

    Attributes:
        hidden: float [R, S U], what comes out of the hidden layers.
        slopes: float [R, S U], their activation's derivative.
        logits: float [R, S, A].
    """

    hidden: Array
    slopes: Array
    logits: Array


class Cotangents(NamedTuple):
    """A loss's gradient in what comes out of each layer, before its activation.

    Attributes:
        hidden: float [N, S U].
        logits: float [N, S, A].
    """

    hidden: Array
    logits: Array


class Tangent(NamedTuple):
    """How a network's signals change along a direction.

    Attributes:
        hidden: float [N, S U], what comes out of the hidden layers.
        totals: float [N, S U], the same before the activation.
        logits: float [N, S, A].
    """

    hidden: Array
    totals: Array
    logits: Array


def forward(theta: Array, network: Network) -> Signals:
    """The logits in all states, with all that their derivatives need."""
    rows = np.atleast_2d(theta)
    return Signals(*passes.forward(rows, network.layers, network.observed(rows), network.kind))


def pullback(theta: Array, network: Network, at: Signals, cotangent: Array) -> tuple[Array, Cotangents]:
    """The gradient of a loss in the parameters.

    Args:
        theta: float [.., P].
        network: its shape.
        at: `forward` of these.
        cotangent: float [N, S, A], the loss's gradient in the logits.

    Returns:
        float [N, P], and the loss's gradient in what comes out of each layer.
    """
    rows = np.atleast_2d(theta)
    gradient, hidden = passes.pullback(
        rows, network.layers, network.observed(rows), at.hidden, at.slopes, cotangent
    )
    return gradient, Cotangents(hidden, cotangent)


def pushforward(theta: Array, network: Network, at: Signals, direction: Array) -> Tangent:
    """The derivative of the signals along a direction [N, P], or [1, P] for all of N rows of parameters."""
    rows = np.atleast_2d(theta)
    found = passes.pushforward(rows, network.layers, network.observed(rows), at.hidden, at.slopes, direction)
    return Tangent(*found)


def pullback_dot(
    theta: Array,
    network: Network,
    at: Signals,
    cotangents: Cotangents,
    direction: Array,
    tangent: Tangent,
    cotangent_dot: Array,
    *,
    summed: bool = False,
) -> Array:
    """The derivative of `pullback` along a direction.

    Args:
        theta: float [.., P].
        network: its shape.
        at: `forward` of these.
        cotangents: of `pullback`.
        direction: float [N, P], or [1, P] for all tasks.
        tangent: `pushforward` of it.
        cotangent_dot: float [N, S, A], how the loss's gradient in the logits changes.
        summed: over the tasks, which must share the parameters.

    Returns:
        float [N, P], or [P].
    """
    rows = np.atleast_2d(theta)
    result: Array = passes.pullback_dot(
        rows,
        network.layers,
        network.observed(rows),
        at.hidden,
        at.slopes,
        cotangents.logits,
        cotangents.hidden,
        direction,
        tangent.hidden,
        tangent.totals,
        cotangent_dot,
        network.kind,
        summed,
    )
    return result[0] if summed else result
