"""The passes of `network`, compiled: a task after the other, one call for many tasks.

Units of the hidden layers stand side by side in one row [S U] of a task, a layer's [S, outputs] after the
other's. Axes: R rows of parameters, 1 for all tasks or N; I inputs and O outputs of a layer.
"""

from __future__ import annotations

import numpy as np

from merap.learning.core.jit import Array, Numbers, compiled

RELU, TANH, SOFTPLUS = 0, 1, 2


@compiled
def forward(theta: Array, sizes: Numbers, features: Array, kind: int) -> tuple[Array, Array, Array]:
    """Values and slopes of the hidden units [R, S U], and logits [R, S, A].

    Args:
        theta: float [R, P].
        sizes: int64 [L + 1], of the observation and of what comes out of each layer.
        features: float [S, F], the observation of each state; [0, 0] if it is the state, one-hot.
        kind: of the activation.
    """
    num_states = len(features) if len(features) else sizes[0]
    units = num_states * sizes[1:-1].sum()
    hidden = np.empty((len(theta), units), dtype=theta.dtype)
    slopes = np.empty((len(theta), units), dtype=theta.dtype)
    logits = np.empty((len(theta), num_states, sizes[-1]), dtype=theta.dtype)
    for r in range(len(theta)):
        start, end = 0, 0
        before = features
        for layer in range(len(sizes) - 1):
            inputs, outputs = sizes[layer], sizes[layer + 1]
            middle = start + inputs * outputs
            weight = theta[r, start:middle].reshape(inputs, outputs)
            bias = theta[r, middle : middle + outputs]
            last = layer == len(sizes) - 2
            size = num_states * outputs
            total = logits[r] if last else hidden[r, end : end + size].reshape(num_states, outputs)
            _affine(before, weight, bias, total)
            if not last:
                _activate(hidden[r, end : end + size], slopes[r, end : end + size], kind)
            before, start, end = total, middle + outputs, end + size
    return hidden, slopes, logits


@compiled
def _affine(before: Array, weight: Array, bias: Array, total: Array) -> None:
    """Fill total [S, O]; a one-hot signal [0, 0] times the weight is the weight."""
    num_states, outputs = total.shape
    if len(before):
        np.dot(before, weight, total)
    else:
        total[:] = weight
    for s in range(num_states):
        for o in range(outputs):
            total[s, o] += bias[o]


@compiled
def _activate(units: Array, slopes: Array, kind: int) -> None:
    """Put values [S O] in the place of what comes out of a layer; fill the slopes."""
    one = units.dtype.type(1)
    for u in range(len(units)):
        if kind == RELU:
            slopes[u] = one if units[u] > 0 else 0 * one
            units[u] *= slopes[u]
        elif kind == TANH:
            units[u] = np.tanh(units[u])
            slopes[u] = one - units[u] * units[u]
        else:
            slopes[u] = one / (one + np.exp(-units[u]))
            units[u] = np.logaddexp(units[u], 0 * one)


@compiled
def pullback(
    theta: Array, sizes: Numbers, features: Array, hidden: Array, slopes: Array, cotangent: Array
) -> tuple[Array, Array]:
    """Gradients [N, P], and those in what comes out of the hidden layers [N, S U].

    Args:
        theta: float [R, P].
        sizes: as in `forward`.
        features: likewise.
        hidden: float [R, S U], of `forward`.
        slopes: likewise.
        cotangent: float [N, S, A], the gradient in the logits.
    """
    num_tasks, num_states, _ = cotangent.shape
    gradient = np.empty((num_tasks, theta.shape[1]), dtype=theta.dtype)
    cotangents = np.empty((num_tasks, hidden.shape[1]), dtype=theta.dtype)
    for n in range(num_tasks):
        r = n if len(theta) > 1 else 0
        above, end, unit = cotangent[n], theta.shape[1], hidden.shape[1]
        for layer in range(len(sizes) - 2, -1, -1):
            inputs, outputs = sizes[layer], sizes[layer + 1]
            middle = end - outputs
            start = middle - inputs * outputs
            size = num_states * inputs
            before = hidden[r, unit - size : unit].reshape(num_states, inputs) if layer else features
            _outer(before, above, gradient[n, start:middle].reshape(inputs, outputs))
            _over_states(above, gradient[n, middle:end])
            if layer:
                below = cotangents[n, unit - size : unit].reshape(num_states, inputs)
                np.dot(above, theta[r, start:middle].reshape(inputs, outputs).T, below)
                _scale(below, slopes[r, unit - size : unit].reshape(num_states, inputs))
                above = below
            end, unit = start, unit - size
    return gradient, cotangents


@compiled
def _outer(before: Array, above: Array, product: Array) -> None:
    """Fill [I, O] with the sum over states of before times above."""
    if len(before):
        np.dot(before.T, above, product)
    else:
        product[:] = above


@compiled
def _over_states(above: Array, total: Array) -> None:
    """Fill [O] with the sum over states."""
    total[:] = 0
    num_states, outputs = above.shape
    for s in range(num_states):
        for o in range(outputs):
            total[o] += above[s, o]


@compiled
def _scale(array: Array, by: Array) -> None:
    """Multiply an array [S, O] entry by entry."""
    num_states, outputs = array.shape
    for s in range(num_states):
        for o in range(outputs):
            array[s, o] *= by[s, o]


@compiled
def _add(array: Array, term: Array) -> None:
    """Add to an array, both of two axes."""
    rows, columns = array.shape
    for i in range(rows):
        for j in range(columns):
            array[i, j] += term[i, j]


@compiled
def pushforward(
    theta: Array, sizes: Numbers, features: Array, hidden: Array, slopes: Array, direction: Array
) -> tuple[Array, Array, Array]:
    """Derivatives along a direction: of the hidden units' values and totals [N, S U], of the logits.

    Args:
        theta: float [R, P].
        sizes: as in `forward`.
        features: likewise.
        hidden: float [R, S U], of `forward`.
        slopes: likewise.
        direction: float [R, P]; there are as many tasks as the longer of theta and direction has rows.
    """
    num_tasks = max(len(theta), len(direction))
    num_states = len(features) if len(features) else sizes[0]
    signals = np.empty((num_tasks, hidden.shape[1]), dtype=theta.dtype)
    totals = np.empty((num_tasks, hidden.shape[1]), dtype=theta.dtype)
    logits = np.empty((num_tasks, num_states, sizes[-1]), dtype=theta.dtype)
    for n in range(num_tasks):
        r, d = n if len(theta) > 1 else 0, n if len(direction) > 1 else 0
        before, signal, start, unit = features, features, 0, 0
        for layer in range(len(sizes) - 1):
            inputs, outputs = sizes[layer], sizes[layer + 1]
            middle = start + inputs * outputs
            end, size = middle + outputs, num_states * outputs
            last = layer == len(sizes) - 2
            total = logits[n] if last else totals[n, unit : unit + size].reshape(num_states, outputs)
            change = direction[d, start:middle].reshape(inputs, outputs)
            _affine(before, change, direction[d, middle:end], total)
            if layer:
                _add(total, np.dot(signal, theta[r, start:middle].reshape(inputs, outputs)))
            if not last:
                before = hidden[r, unit : unit + size].reshape(num_states, outputs)
                signal = signals[n, unit : unit + size].reshape(num_states, outputs)
                signal[:] = total
                _scale(signal, slopes[r, unit : unit + size].reshape(num_states, outputs))
            start, unit = end, unit + size
    return signals, totals, logits


@compiled
def pullback_dot(
    theta: Array,
    sizes: Numbers,
    features: Array,
    hidden: Array,
    slopes: Array,
    cotangent: Array,
    cotangents: Array,
    direction: Array,
    signals: Array,
    totals: Array,
    cotangent_dot: Array,
    kind: int,
    summed: bool,
) -> Array:
    """The derivative of `pullback` along a direction, float [N, P]; [1, P], the sum, if it is to be summed.

    Args:
        theta: float [R, P]; one row, if it is to be summed.
        sizes: as in `forward`.
        features: likewise.
        hidden: float [R, S U], of `forward`.
        slopes: likewise.
        cotangent: float [N, S, A], the gradient in the logits.
        cotangents: float [N, S U], of `pullback`.
        direction: float [N, P], or [1, P] for all tasks.
        signals: float [N, S U] or [1, S U], of `pushforward`.
        totals: likewise.
        cotangent_dot: float [N, S, A], how the gradient in the logits changes.
        kind: of the activation.
        summed: over the tasks.
    """
    num_tasks, num_states, _ = cotangent.shape
    groups = 1 if summed else num_tasks
    result = np.empty((groups, theta.shape[1]), dtype=theta.dtype)
    for g in range(groups):
        r, tasks = g if len(theta) > 1 else 0, range(num_tasks) if summed else range(g, g + 1)
        above_dot = np.zeros_like(cotangent_dot[0])
        for n in tasks:
            _add(above_dot, cotangent_dot[n])
        end, unit = theta.shape[1], hidden.shape[1]
        for layer in range(len(sizes) - 2, -1, -1):
            inputs, outputs = sizes[layer], sizes[layer + 1]
            middle = end - outputs
            start, size = middle - inputs * outputs, num_states * inputs
            before = hidden[r, unit - size : unit].reshape(num_states, inputs) if layer else features
            of_weight = result[g, start:middle].reshape(inputs, outputs)
            _outer(before, above_dot, of_weight)
            _over_states(above_dot, result[g, middle:end])
            if layer:
                weight = theta[r, start:middle].reshape(inputs, outputs)
                slope = slopes[r, unit - size : unit].reshape(num_states, inputs)
                below_dot = np.dot(above_dot, weight.T)
                for n in tasks:
                    above = _of_layer(cotangent, cotangents, n, layer, sizes, unit)
                    d = n if len(direction) > 1 else 0
                    signal = signals[d, unit - size : unit].reshape(num_states, inputs)
                    _add(of_weight, np.dot(signal.T, above))
                    change = direction[d, start:middle].reshape(inputs, outputs)
                    _add(below_dot, np.dot(above, change.T))
                _scale(below_dot, slope)
                if kind != RELU:
                    for n in tasks:
                        above = _of_layer(cotangent, cotangents, n, layer, sizes, unit)
                        d = n if len(direction) > 1 else 0
                        total = totals[d, unit - size : unit].reshape(num_states, inputs)
                        _add_bent(below_dot, np.dot(above, weight.T), total, before, slope, kind)
                above_dot = below_dot
            end, unit = start, unit - size
    return result


@compiled
def _of_layer(cotangent: Array, cotangents: Array, n: int, layer: int, sizes: Numbers, unit: int) -> Array:
    """The gradient [S, O] in what comes out of a layer whose inputs end at a unit."""
    if layer == len(sizes) - 2:
        last: Array = cotangent[n]
        return last
    num_states, outputs = cotangent.shape[1], sizes[layer + 1]
    return cotangents[n, unit : unit + num_states * outputs].reshape(num_states, outputs)


@compiled
def _add_bent(array: Array, below: Array, total: Array, value: Array, slope: Array, kind: int) -> None:
    """Add below times total times the activation's second derivative; all are [S, O]."""
    one = array.dtype.type(1)
    num_states, outputs = array.shape
    for s in range(num_states):
        for o in range(outputs):
            if kind == TANH:
                curvature = -2 * one * value[s, o] * slope[s, o]
            else:
                curvature = slope[s, o] * (one - slope[s, o])
            array[s, o] += below[s, o] * total[s, o] * curvature
