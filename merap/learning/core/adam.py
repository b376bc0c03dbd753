"""Adam's step (Kingma & Ba 2015, algorithm 1), compiled."""

from __future__ import annotations

import math

from merap.learning.core.jit import Array, compiled


@compiled
def descend(
    values: Array,
    gradient: Array,
    first: Array,
    second: Array,
    count: int,
    rate: float,
    beta1: float,
    beta2: float,
    epsilon: float,
) -> None:
    """Change values, all [P], and the moments of the gradient with them.

    Args:
        values: what descends.
        gradient: its gradient.
        first: running mean of the gradient.
        second: likewise, of its square.
        count: of steps, this one included.
        rate: length of a step.
        beta1: how much of the first moment stays.
        beta2: likewise, of the second.
        epsilon: least unit of a step.
    """
    length, unit = rate / (1 - beta1**count), math.sqrt(1 - beta2**count)
    for p in range(len(values)):
        first[p] += (1 - beta1) * (gradient[p] - first[p])
        second[p] = beta2 * second[p] + (1 - beta2) * gradient[p] * gradient[p]
        values[p] -= length * first[p] / (math.sqrt(second[p]) / unit + epsilon)
