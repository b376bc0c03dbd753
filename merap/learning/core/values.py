"""The exact value of policies on known tasks, with gradient and products of its Hessian.

Over a horizon of T steps J = initial' V_T with

    V_h(s) = sum_a pi(s, a) Q_h(s, a),   Q_h(s, a) = r(s, a) + sum_k w(s, a, k) V_h-1(s'_k),   V_0 = 0

with h steps to go and w the discounted probability to go on in the k-th successor. Its gradient is
dJ/dpi(s, a) = sum_t d_t(s) Q_T-t(s, a) with the discounted probability d_t to be in s at time t
(Sutton et al. 2000, theorem 1). A Hessian product is the derivative of both recursions along a
direction. No state is looked at before an episode can have got there: V_h is worked out where T - h
steps can lead.

Over an infinite horizon see `fixed_point`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from merap.learning.core import fixed_point
from merap.learning.core.jit import Array, Successors, Times, compiled
from merap.learning.core.task import Tasks


class Values(NamedTuple):
    """What policies are worth.

    Attributes:
        total: float [N], J.
        to_go: float [N, T + 1, S], V_h with h steps to go; over an infinite horizon [N, 1, S].
        occupancy: float [N, T + 1, S], d_t, the last that after the horizon; or visits [N, 1, S].
        gradient: float [N, S, A], dJ/dpi; means nothing where an action is disabled.
    """

    total: Array
    to_go: Array
    occupancy: Array
    gradient: Array

    @property
    def visits(self) -> Array:
        """float [N, S], share of the discounted steps that begin in a state."""
        steps = max(1, self.occupancy.shape[1] - 1)
        counted: Array = self.occupancy[:, :steps].sum(axis=1)
        shares: Array = counted / counted.sum(axis=1, keepdims=True)
        return shares


def values(policy: Array, tasks: Tasks, horizon: int) -> Values:
    """J and its gradient.

    Args:
        policy: float [N, S, A], 0 for disabled actions.
        tasks: N of them.
        horizon: T; 0: infinite.
    """
    if horizon:
        to_go = _to_go(policy, tasks.weight, tasks.expected, tasks.successor, tasks.earliest, horizon)
        occupancy, gradient = _occupancy(
            policy, to_go, tasks.initial, tasks.weight, tasks.expected, tasks.successor, tasks.earliest
        )
    else:
        to_go, occupancy, gradient = fixed_point.values(policy, tasks)
    return Values(np.einsum("ns,ns->n", tasks.initial, to_go[:, -1]), to_go, occupancy, gradient)


def hessian_product(policy: Array, found: Values, direction: Array, tasks: Tasks) -> Array:
    """float [N, S, A]: the Hessian of J with respect to pi times a direction [N, S, A]."""
    if found.to_go.shape[1] == 1:
        return fixed_point.hessian_product(policy, found.to_go, found.occupancy, direction, tasks)
    arrays = (tasks.weight, tasks.expected, tasks.successor, tasks.earliest)
    to_go_dot = _to_go_dot(policy, direction, found.to_go, *arrays)
    return _occupancy_dot(policy, direction, found.to_go, to_go_dot, found.occupancy, *arrays)


@compiled
def _to_go(
    policy: Array, weight: Array, expected: Array, successor: Successors, earliest: Times, horizon: int
) -> Array:
    """V_h [N, T + 1, S]."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    num_branches = num_actions * num_successors
    to_go = np.zeros((num_tasks, horizon + 1, num_states), dtype=policy.dtype)
    gains = np.zeros(num_states, dtype=policy.dtype)
    chain = np.zeros((num_states, num_branches), dtype=policy.dtype)
    for n in range(num_tasks):
        for s in range(num_states):
            gains[s] = 0
            for a in range(num_actions):
                gains[s] += policy[n, s, a] * expected[n, s, a]
                for k in range(num_successors):
                    chain[s, a * num_successors + k] = policy[n, s, a] * weight[n, s, a, k]
        target = successor[n].reshape(num_states, num_branches)
        for h in range(horizon):
            before, after = to_go[n, h], to_go[n, h + 1]
            for s in range(num_states):
                if earliest[n, s] < horizon - h:
                    value = gains[s]
                    for m in range(num_branches):
                        value += chain[s, m] * before[target[s, m]]
                    after[s] = value
    return to_go


@compiled
def _occupancy(
    policy: Array,
    to_go: Array,
    initial: Array,
    weight: Array,
    expected: Array,
    successor: Successors,
    earliest: Times,
) -> tuple[Array, Array]:
    """d_t [N, T + 1, S] and dJ/dpi [N, S, A]."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    horizon = to_go.shape[1] - 1
    occupancy, gradient = np.zeros_like(to_go), np.zeros_like(policy)
    for n in range(num_tasks):
        occupancy[n, 0] = initial[n]
        for t in range(horizon):
            present, following, ahead = occupancy[n, t], occupancy[n, t + 1], to_go[n, horizon - 1 - t]
            for s in range(num_states):
                if earliest[n, s] <= t:
                    mass = present[s]
                    for a in range(num_actions):
                        worth, moved = expected[n, s, a], mass * policy[n, s, a]
                        for k in range(num_successors):
                            target, part = successor[n, s, a, k], weight[n, s, a, k]
                            worth += part * ahead[target]
                            following[target] += moved * part
                        gradient[n, s, a] += mass * worth
    return occupancy, gradient


@compiled
def _to_go_dot(
    policy: Array,
    direction: Array,
    to_go: Array,
    weight: Array,
    expected: Array,
    successor: Successors,
    earliest: Times,
) -> Array:
    """V._h = sum_a pi. Q_h + pi sum_k w V._h-1 from V._0 = 0; [N, T + 1, S]."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    horizon = to_go.shape[1] - 1
    to_go_dot = np.zeros_like(to_go)
    for n in range(num_tasks):
        for h in range(horizon):
            before, before_dot, after_dot = to_go[n, h], to_go_dot[n, h], to_go_dot[n, h + 1]
            for s in range(num_states):
                if earliest[n, s] < horizon - h:
                    total = policy.dtype.type(0)
                    for a in range(num_actions):
                        worth, worth_dot = expected[n, s, a], policy.dtype.type(0)
                        for k in range(num_successors):
                            target, part = successor[n, s, a, k], weight[n, s, a, k]
                            worth += part * before[target]
                            worth_dot += part * before_dot[target]
                        total += direction[n, s, a] * worth + policy[n, s, a] * worth_dot
                    after_dot[s] = total
    return to_go_dot


@compiled
def _occupancy_dot(
    policy: Array,
    direction: Array,
    to_go: Array,
    to_go_dot: Array,
    occupancy: Array,
    weight: Array,
    expected: Array,
    successor: Successors,
    earliest: Times,
) -> Array:
    """sum_t d._t Q_T-t + d_t Q._T-t, where d._t+1(s') sums w (d._t pi + d_t pi.) from d._0 = 0; [N, S, A]."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    horizon = to_go.shape[1] - 1
    result = np.zeros_like(policy)
    present_dot, following_dot = np.zeros_like(to_go[0, 0]), np.zeros_like(to_go[0, 0])
    for n in range(num_tasks):
        present_dot[:] = 0
        for t in range(horizon):
            following_dot[:] = 0
            ahead, ahead_dot = to_go[n, horizon - 1 - t], to_go_dot[n, horizon - 1 - t]
            for s in range(num_states):
                if earliest[n, s] <= t:
                    mass, mass_dot = occupancy[n, t, s], present_dot[s]
                    for a in range(num_actions):
                        worth, worth_dot = expected[n, s, a], policy.dtype.type(0)
                        moved_dot = mass_dot * policy[n, s, a] + mass * direction[n, s, a]
                        for k in range(num_successors):
                            target, part = successor[n, s, a, k], weight[n, s, a, k]
                            worth += part * ahead[target]
                            worth_dot += part * ahead_dot[target]
                            following_dot[target] += moved_dot * part
                        result[n, s, a] += mass_dot * worth + mass * worth_dot
            present_dot, following_dot = following_dot, present_dot
    return result
