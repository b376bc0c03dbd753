"""The exact discounted value of policies over an infinite horizon, by implicit differentiation.

Values and visits are fixed points, V = r_pi + C V and d = initial + C' d with
C(s, s') = sum_a pi(s, a) w(s, a, s'). They are differentiated as such, not through the sweeps that find
them (the implicit function theorem): dJ/dpi(s, a) = d(s) Q(s, a), and along a direction
V. = sum_a pi. Q + C V. and d. = C.' d + C' d. are solved like V and d. For models with a long horizon this
takes the place of the recursion over steps, whose cost and memory grow with T.
"""

from __future__ import annotations

import numpy as np

from merap.learning.core.jit import Array, Successors, compiled
from merap.learning.core.task import Tasks

# Fixed points are found to that accuracy, relative to the largest value; single precision allows no more.
ACCURACY, SINGLE_ACCURACY = 1e-13, 1e-7
MOST_SWEEPS = 10_000_000


def values(policy: Array, tasks: Tasks) -> tuple[Array, Array, Array]:
    """V [N, 1, S], d [N, 1, S] and dJ/dpi [N, S, A] of policies [N, S, A]."""
    gains = np.einsum("nsa,nsa->ns", policy, tasks.expected)
    to_go = _solved_values(policy, gains, tasks.weight, tasks.successor)
    visits = _solved_visits(policy, tasks.initial, tasks.weight, tasks.successor)
    gradient = visits[..., np.newaxis] * (tasks.expected + _following(to_go, tasks))
    return to_go[:, np.newaxis], visits[:, np.newaxis], gradient


def hessian_product(policy: Array, to_go: Array, visits: Array, direction: Array, tasks: Tasks) -> Array:
    """float [N, S, A]: the Hessian of J with respect to pi times a direction, from V and d [N, 1, S]."""
    action_values = tasks.expected + _following(to_go[:, 0], tasks)
    gains_dot = np.einsum("nsa,nsa->ns", direction, action_values)
    to_go_dot = _solved_values(policy, gains_dot, tasks.weight, tasks.successor)
    arrivals = _arrivals(direction, visits[:, 0], tasks.weight, tasks.successor)
    visits_dot = _solved_visits(policy, arrivals, tasks.weight, tasks.successor)
    product: Array = visits_dot[..., np.newaxis] * action_values
    product += visits[:, 0, :, np.newaxis] * _following(to_go_dot, tasks)
    return product


def _following(to_go: Array, tasks: Tasks) -> Array:
    """float [N, S, A]: sum over k of w V(s'_k)."""
    number = np.arange(len(to_go))[:, np.newaxis, np.newaxis, np.newaxis]
    following: Array = np.einsum("nsak,nsak->nsa", tasks.weight, to_go[number, tasks.successor])
    return following


@compiled
def _solved_values(policy: Array, gains: Array, weight: Array, successor: Successors) -> Array:
    """V [N, S] = gains [N, S] + C V, by Gauss-Seidel sweeps in alternating order."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    solution = np.zeros_like(gains)
    accuracy = ACCURACY if gains.itemsize == 8 else SINGLE_ACCURACY
    for n in range(num_tasks):
        for sweep in range(MOST_SWEEPS):
            change = size = 0.0
            for i in range(num_states):
                s = i if sweep % 2 else num_states - 1 - i
                value = gains[n, s]
                for a in range(num_actions):
                    if policy[n, s, a] != 0:
                        for k in range(num_successors):
                            ahead = solution[n, successor[n, s, a, k]]
                            value += policy[n, s, a] * weight[n, s, a, k] * ahead
                change = max(change, abs(value - solution[n, s]))
                size = max(size, abs(value))
                solution[n, s] = value
            if change <= accuracy * size:
                break
    return solution


@compiled
def _solved_visits(policy: Array, arrivals: Array, weight: Array, successor: Successors) -> Array:
    """d [N, S] = arrivals [N, S] + C' d, by pushing on what has arrived and not yet gone on."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
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
                    for a in range(num_actions):
                        for k in range(num_successors):
                            target = successor[n, s, a, k]
                            waiting[n, target] += mass * policy[n, s, a] * weight[n, s, a, k]
                size = max(size, abs(visits[n, s]))
            if pushed <= accuracy * size:
                break
    return visits


@compiled
def _arrivals(direction: Array, visits: Array, weight: Array, successor: Successors) -> Array:
    """C.' d, float [N, S]."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    arrivals = np.zeros_like(visits)
    for n in range(num_tasks):
        for s in range(num_states):
            for a in range(num_actions):
                for k in range(num_successors):
                    moved = visits[n, s] * direction[n, s, a] * weight[n, s, a, k]
                    arrivals[n, successor[n, s, a, k]] += moved
    return arrivals
