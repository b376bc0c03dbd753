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

from merap.learning.core.jit import Array

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

    @property
    def num_layers(self) -> int:
        """L."""
        return len(self.sizes) - 1

    @cached_property
    def bounds(self) -> tuple[tuple[int, int, int], ...]:
        """Where each layer's weight begins, where its bias does, and where that ends."""
        ends = accumulate((inputs + 1) * outputs for inputs, outputs in pairwise(self.sizes))
        return tuple(
            (end - (inputs + 1) * outputs, end - outputs, end)
            for end, (inputs, outputs) in zip(ends, pairwise(self.sizes), strict=True)
        )

    def weight(self, theta: Array, layer: int) -> Array:
        """[.., inputs, outputs], a view."""
        start, middle, _ = self.bounds[layer]
        return theta[..., start:middle].reshape(*theta.shape[:-1], *self.sizes[layer : layer + 2])

    def bias(self, theta: Array, layer: int) -> Array:
        """[.., 1, outputs], a view."""
        _, middle, end = self.bounds[layer]
        return theta[..., np.newaxis, middle:end]


class Signals(NamedTuple):
    """What a network does in all states.

    Attributes:
        inputs: float [.., S, inputs] of each layer; features for the first.
        slopes: float [.., S, outputs] of each hidden layer, its activation's derivative.
        logits: float [.., S, A].
    """

    inputs: list[Array | None]
    slopes: list[Array]
    logits: Array


class Tangent(NamedTuple):
    """How a network's signals change along a direction.

    Attributes:
        inputs: float [N, S, inputs] of each layer; None for the first, a constant.
        totals: float [N, S, outputs] of each layer, before its activation.
    """

    inputs: list[Array | None]
    totals: list[Array]

    @property
    def logits(self) -> Array:
        """float [N, S, A]."""
        return self.totals[-1]


def forward(theta: Array, network: Network) -> Signals:
    """The logits in all states, with all that their derivatives need."""
    inputs, slopes = [network.features], []
    total = _affine(network.features, theta, network, 0)
    for layer in range(1, network.num_layers):
        value, slope = _activate(total, network.activation)
        inputs.append(value)
        slopes.append(slope)
        total = _affine(value, theta, network, layer)
    return Signals(inputs, slopes, total)


def pullback(theta: Array, network: Network, at: Signals, cotangent: Array) -> tuple[Array, list[Array]]:
    """The gradient of a loss in the parameters.

    Args:
        theta: float [.., P].
        network: its shape.
        at: `forward` of these.
        cotangent: float [N, S, A], the loss's gradient in the logits.

    Returns:
        float [N, P], and the loss's gradient in what comes out of each layer, float [N, S, outputs].
    """
    gradient = np.empty((len(cotangent), theta.shape[-1]), dtype=theta.dtype)
    cotangents = [cotangent]
    for layer in reversed(range(network.num_layers)):
        network.weight(gradient, layer)[:] = _outer(at.inputs[layer], cotangent)
        _over_states(cotangent, network.bias(gradient, layer))
        if layer:
            cotangent = cotangent @ network.weight(theta, layer).mT
            cotangent *= at.slopes[layer - 1]
            cotangents.insert(0, cotangent)
    return gradient, cotangents


def pushforward(theta: Array, network: Network, at: Signals, direction: Array) -> Tangent:
    """The derivative of the signals along a direction [N, P]."""
    total = _affine(network.features, direction, network, 0)
    tangent = Tangent([None], [total])
    for layer in range(1, network.num_layers):
        signal = at.slopes[layer - 1] * total
        total = _affine(at.inputs[layer], direction, network, layer)
        total += signal @ network.weight(theta, layer)
        tangent.inputs.append(signal)
        tangent.totals.append(total)
    return tangent


def pullback_dot(
    theta: Array,
    network: Network,
    at: Signals,
    cotangents: list[Array],
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
        direction: float [N, P].
        tangent: `pushforward` of it.
        cotangent_dot: float [N, S, A], how the loss's gradient in the logits changes.
        summed: over the tasks, which must share the parameters.

    Returns:
        float [N, P], or [P].
    """
    if summed:
        cotangent_dot = cotangent_dot.sum(axis=0)
    result = np.empty((*cotangent_dot.shape[:-2], theta.shape[-1]), dtype=theta.dtype)
    for layer in reversed(range(network.num_layers)):
        of_weight, of_theta = network.weight(result, layer), network.weight(theta, layer)
        of_weight[:] = _outer(at.inputs[layer], cotangent_dot)
        _over_states(cotangent_dot, network.bias(result, layer))
        signal = tangent.inputs[layer]
        if signal is not None:
            cotangent = cotangents[layer]
            of_direction = network.weight(direction, layer)
            of_weight += _summed_outer(signal, cotangent) if summed else signal.mT @ cotangent
            spread = cotangent_dot @ of_theta.mT
            spread += (_summed_product if summed else np.matmul)(cotangent, of_direction.mT)
            spread *= at.slopes[layer - 1]
            if network.activation != "relu":
                bent = (cotangent @ of_theta.mT) * tangent.totals[layer - 1]
                bent *= _curvature(at.inputs[layer], at.slopes[layer - 1], network.activation)
                spread += bent.sum(axis=0) if summed else bent
            cotangent_dot = spread
    return result


def _affine(signal: Array | None, theta: Array, network: Network, layer: int) -> Array:
    """What comes out of a layer; a one-hot signal times the weight is a row of the weight."""
    weight = network.weight(theta, layer)
    if signal is None:
        return weight + network.bias(theta, layer)
    total: Array = signal @ weight
    total += network.bias(theta, layer)
    return total


def _outer(signal: Array | None, cotangent: Array) -> Array:
    """[.., inputs, outputs]: sum over states of signal times cotangent."""
    return cotangent if signal is None else signal.mT @ cotangent


def _over_states(cotangent: Array, out: Array) -> None:
    """[.., 1, outputs]: sum over states, as a product, which is several times faster than a sum."""
    np.matmul(np.ones((1, cotangent.shape[-2]), dtype=cotangent.dtype), cotangent, out=out)


def _summed_outer(signal: Array, cotangent: Array) -> Array:
    """[inputs, outputs]: sum over tasks and states."""
    product: Array = signal.reshape(-1, signal.shape[-1]).T @ cotangent.reshape(-1, cotangent.shape[-1])
    return product


def _summed_product(left: Array, right: Array) -> Array:
    """Sum over N of left [N, I, J] @ right [N, J, K], as one product of [I, N J] and [N J, K]."""
    columns = np.moveaxis(left, 0, 1).reshape(left.shape[1], -1)
    product: Array = columns @ right.reshape(-1, right.shape[-1])
    return product


def _activate(total: Array, activation: Activation) -> tuple[Array, Array]:
    """The activation's value and slope."""
    if activation == "relu":
        slope = (total > 0).astype(total.dtype)
        return total * slope, slope
    if activation == "tanh":
        value = np.tanh(total)
        return value, 1 - value * value
    return np.logaddexp(total, 0, dtype=total.dtype), 1 / (1 + np.exp(-total))


def _curvature(value: Array | None, slope: Array, activation: Activation) -> Array:
    """The activation's second derivative; that of relu is 0."""
    if activation == "tanh":
        assert value is not None
        return -2 * value * slope
    return slope * (1 - slope)
