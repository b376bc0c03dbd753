"""Fixed points of a policy's chain: discounted values and visits over an infinite horizon.

V = r + C V and d = initial + C' d with C(s, s') = sum_a pi(s, a) w(s, a, s') are differentiated as such, not
through the sweeps that find them (the implicit function theorem): dJ/dpi(s, a) = d(s) Q(s, a), and along a
direction V. = r. + C. V + C V. and d. = C.' d + C' d. are solved like V and d. For models with a long
horizon this takes the place of the recursion over steps, whose cost and memory grow with T.

A chain is float [N, S, M], its M branches of a state lead to `target`.
"""

from __future__ import annotations

import numpy as np

from merap.learning.core.jit import Array, Successors, compiled

# Fixed points are found to that accuracy, relative to the largest value; single precision allows no more.
ACCURACY, SINGLE_ACCURACY = 1e-13, 1e-7
MOST_SWEEPS = 10_000_000


@compiled
def solved_values(gains: Array, chain: Array, target: Successors) -> Array:
    """V [N, S] = gains [N, S] + C V, by Gauss-Seidel sweeps in alternating order."""
    num_tasks, num_states, num_branches = chain.shape
    solution = np.zeros_like(gains)
    accuracy = ACCURACY if gains.itemsize == 8 else SINGLE_ACCURACY
    for n in range(num_tasks):
        for sweep in range(MOST_SWEEPS):
            change = size = 0.0
            for i in range(num_states):
                s = i if sweep % 2 else num_states - 1 - i
                value = gains[n, s]
                for m in range(num_branches):
                    value += chain[n, s, m] * solution[n, target[n, s, m]]
                change = max(change, abs(value - solution[n, s]))
                size = max(size, abs(value))
                solution[n, s] = value
            if change <= accuracy * size:
                break
    return solution


@compiled
def solved_visits(arrivals: Array, chain: Array, target: Successors) -> Array:
    """d [N, S] = arrivals [N, S] + C' d, by pushing on what has arrived and not yet gone on."""
    num_tasks, num_states, num_branches = chain.shape
    visits, waiting = np.zeros_like(arrivals), arrivals.copy()
    accuracy = ACCURACY if arrivals.itemsize == 8 else SINGLE_ACCURACY
    for n in range(num_tasks):
        for sweep in range(MOST_SWEEPS):
            pushed = size = 0.0
            for i in range(num_states):
                s = num_states - 1 - i if sweep % 2 else i
                mass = waiting[n, s]
                if mass != 0:
                    waiting[n, s] = 0
                    visits[n, s] += mass
                    pushed = max(pushed, abs(mass))
                    for m in range(num_branches):
                        waiting[n, target[n, s, m]] += mass * chain[n, s, m]
                size = max(size, abs(visits[n, s]))
            if pushed <= accuracy * size:
                break
    return visits


@compiled
def arrivals(chain: Array, visits: Array, target: Successors) -> Array:
    """C' d, float [N, S]."""
    num_tasks, num_states, num_branches = chain.shape
    result = np.zeros_like(visits)
    for n in range(num_tasks):
        for s in range(num_states):
            for m in range(num_branches):
                result[n, target[n, s, m]] += visits[n, s] * chain[n, s, m]
    return result
