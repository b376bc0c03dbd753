"""The exact value of policies on known tasks, with gradient and products of its Hessian.

Over a horizon of T steps J = initial' V_T with

    V_h(s) = sum_a pi(s, a) Q_h(s, a),   Q_h(s, a) = r(s, a) + sum_k w(s, a, k) V_h-1(s'_k),   V_0 = 0

with h steps to go and w the discounted probability to go on in the k-th successor. Its gradient is
dJ/dpi(s, a) = sum_t d_t(s) Q_T-t(s, a) with the discounted probability d_t to be in s at time t
(Sutton et al. 2000, theorem 1). A Hessian product is the derivative of both recursions along a
direction. No state is looked at before an episode can have got there: V_h is worked out where T - h
steps can lead.

Over an infinite horizon see `fixed_point`. M = A K are the branches of a state.
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
        visits: float [N, S], discounted number of steps that begin in a state.
        gradient: float [N, S, A], dJ/dpi; means nothing where an action is disabled.
    """

    total: Array
    to_go: Array
    occupancy: Array
    visits: Array
    gradient: Array


def values(policy: Array, tasks: Tasks, horizon: int) -> Values:
    """J and its gradient.

    Args:
        policy: float [N, S, A], 0 for disabled actions.
        tasks: N of them.
        horizon: T; 0: infinite.
    """
    initial, weight, expected, target = tasks.initial, tasks.weight, tasks.expected, tasks.target
    if horizon:
        return Values(*_finite(policy, weight, expected, target, tasks.earliest, initial, horizon))
    chain = tasks.chain(policy)
    to_go = fixed_point.solved_values(_gains(policy, expected), chain, target)
    visits = fixed_point.solved_visits(initial, chain, target)
    gradient = _of_actions(visits, _met(visits, to_go, tasks), weight, expected)
    total = np.einsum("ns,ns->n", initial, to_go)
    return Values(total, to_go[:, np.newaxis], visits[:, np.newaxis], visits, gradient)


def hessian_product(policy: Array, found: Values, direction: Array, tasks: Tasks) -> Array:
    """float [N, S, A]: the Hessian of J with respect to pi times a direction [N, S, A]."""
    if found.to_go.shape[1] > 1:
        return _finite_dot(
            policy,
            direction,
            tasks.weight,
            tasks.expected,
            tasks.target,
            tasks.earliest,
            found.to_go,
            found.occupancy,
        )
    to_go, visits = found.to_go[:, 0], found.visits
    chain, chain_dot = tasks.chain(policy), tasks.chain(direction)
    gains_dot = _gains(direction, tasks.expected)
    gains_dot += np.einsum("nsm,nsm->ns", chain_dot, tasks.at_targets(to_go))
    to_go_dot = fixed_point.solved_values(gains_dot, chain, tasks.target)
    arrivals = fixed_point.arrivals(chain_dot, visits, tasks.target)
    visits_dot = fixed_point.solved_visits(arrivals, chain, tasks.target)
    met_dot = _met(visits_dot, to_go, tasks) + _met(visits, to_go_dot, tasks)
    return _of_actions(visits_dot, met_dot, tasks.weight, tasks.expected)


@compiled
def _gains(policy: Array, expected: Array) -> Array:
    """float [N, S], expected reward of a step."""
    num_tasks, num_states, num_actions = policy.shape
    gains = np.zeros((num_tasks, num_states), dtype=policy.dtype)
    for n in range(num_tasks):
        for s in range(num_states):
            for a in range(num_actions):
                gains[n, s] += policy[n, s, a] * expected[n, s, a]
    return gains


@compiled
def _of_actions(visits: Array, met: Array, weight: Array, expected: Array) -> Array:
    """float [N, S, A]: visits(s) r(s, a) + sum_k w(s, a, k) met(s, a, k), of met [N, S, M]."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    result = np.empty_like(expected)
    for n in range(num_tasks):
        for s in range(num_states):
            for a in range(num_actions):
                worth = visits[n, s] * expected[n, s, a]
                for k in range(num_successors):
                    worth += weight[n, s, a, k] * met[n, s, a * num_successors + k]
                result[n, s, a] = worth
    return result


def _met(visits: Array, to_go: Array, tasks: Tasks) -> Array:
    """float [N, S, M]: visits(s) V(s'_m)."""
    met: Array = visits[..., np.newaxis] * tasks.at_targets(to_go)
    return met


@compiled
def _to_go(gains: Array, chain: Array, target: Successors, earliest: Times, horizon: int) -> Array:
    """V_h [N, T + 1, S] of gains [N, S]."""
    num_tasks, num_states, num_branches = chain.shape
    to_go = np.zeros((num_tasks, horizon + 1, num_states), dtype=chain.dtype)
    for n in range(num_tasks):
        for h in range(horizon):
            before, after = to_go[n, h], to_go[n, h + 1]
            for s in range(num_states):
                if earliest[n, s] < horizon - h:
                    value = gains[n, s]
                    for m in range(num_branches):
                        value += chain[n, s, m] * before[target[n, s, m]]
                    after[s] = value
    return to_go


@compiled
def _occupancy(
    initial: Array, chain: Array, target: Successors, earliest: Times, to_go: Array
) -> tuple[Array, Array, Array]:
    """d_t [N, T + 1, S], sum_t d_t(s) [N, S], and sum_t d_t(s) V_T-1-t(s'_m) [N, S, M]; t < T."""
    num_tasks, num_states, num_branches = chain.shape
    horizon = to_go.shape[1] - 1
    occupancy, visits, met = np.zeros_like(to_go), np.zeros_like(initial), np.zeros_like(chain)
    for n in range(num_tasks):
        occupancy[n, 0] = initial[n]
        for t in range(horizon):
            present, following, ahead = occupancy[n, t], occupancy[n, t + 1], to_go[n, horizon - 1 - t]
            for s in range(num_states):
                if earliest[n, s] <= t:
                    mass = present[s]
                    visits[n, s] += mass
                    for m in range(num_branches):
                        to = target[n, s, m]
                        met[n, s, m] += mass * ahead[to]
                        following[to] += mass * chain[n, s, m]
    return occupancy, visits, met


@compiled
def _to_go_dot(
    gains_dot: Array, chain: Array, chain_dot: Array, target: Successors, earliest: Times, to_go: Array
) -> Array:
    """V._h = r. + C. V_h-1 + C V._h-1 from V._0 = 0; [N, T + 1, S]."""
    num_tasks, num_states, num_branches = chain.shape
    horizon = to_go.shape[1] - 1
    to_go_dot = np.zeros_like(to_go)
    for n in range(num_tasks):
        for h in range(horizon):
            before, before_dot, after_dot = to_go[n, h], to_go_dot[n, h], to_go_dot[n, h + 1]
            for s in range(num_states):
                if earliest[n, s] < horizon - h:
                    value = gains_dot[n, s]
                    for m in range(num_branches):
                        to = target[n, s, m]
                        value += chain_dot[n, s, m] * before[to] + chain[n, s, m] * before_dot[to]
                    after_dot[s] = value
    return to_go_dot


@compiled
def _occupancy_dot(
    chain: Array,
    chain_dot: Array,
    target: Successors,
    earliest: Times,
    to_go: Array,
    to_go_dot: Array,
    occupancy: Array,
) -> tuple[Array, Array]:
    """sum_t d._t(s) [N, S] and sum_t d._t(s) V_T-1-t(s'_m) + d_t(s) V._T-1-t(s'_m) [N, S, M].

    With d._t+1 = C.' d_t + C' d._t from d._0 = 0.
    """
    num_tasks, num_states, num_branches = chain.shape
    horizon = to_go.shape[1] - 1
    visits_dot, met_dot = np.zeros_like(to_go[:, 0]), np.zeros_like(chain)
    present_dot, following_dot = np.zeros_like(to_go[0, 0]), np.zeros_like(to_go[0, 0])
    for n in range(num_tasks):
        present_dot[:] = 0
        for t in range(horizon):
            following_dot[:] = 0
            ahead, ahead_dot = to_go[n, horizon - 1 - t], to_go_dot[n, horizon - 1 - t]
            for s in range(num_states):
                if earliest[n, s] <= t:
                    mass, mass_dot = occupancy[n, t, s], present_dot[s]
                    visits_dot[n, s] += mass_dot
                    for m in range(num_branches):
                        to = target[n, s, m]
                        met_dot[n, s, m] += mass_dot * ahead[to] + mass * ahead_dot[to]
                        following_dot[to] += mass_dot * chain[n, s, m] + mass * chain_dot[n, s, m]
            present_dot, following_dot = following_dot, present_dot
    return visits_dot, met_dot


@compiled
def _chain(policy: Array, weight: Array) -> Array:
    """float [N, S, M]: `Tasks.chain`."""
    num_tasks, num_states, num_actions, num_successors = weight.shape
    chain = np.empty((num_tasks, num_states, num_actions * num_successors), dtype=policy.dtype)
    for n in range(num_tasks):
        for s in range(num_states):
            for a in range(num_actions):
                for k in range(num_successors):
                    chain[n, s, a * num_successors + k] = policy[n, s, a] * weight[n, s, a, k]
    return chain


@compiled
def _finite(
    policy: Array,
    weight: Array,
    expected: Array,
    target: Successors,
    earliest: Times,
    initial: Array,
    horizon: int,
) -> tuple[Array, Array, Array, Array, Array]:
    """The fields of `Values`, in one call."""
    chain = _chain(policy, weight)
    to_go = _to_go(_gains(policy, expected), chain, target, earliest, horizon)
    occupancy, visits, met = _occupancy(initial, chain, target, earliest, to_go)
    total = np.zeros_like(to_go[:, 0, 0])
    for n in range(len(total)):
        total[n] = np.sum(initial[n] * to_go[n, horizon])
    return total, to_go, occupancy, visits, _of_actions(visits, met, weight, expected)


@compiled
def _finite_dot(
    policy: Array,
    direction: Array,
    weight: Array,
    expected: Array,
    target: Successors,
    earliest: Times,
    to_go: Array,
    occupancy: Array,
) -> Array:
    """The Hessian product [N, S, A], in one call."""
    chain, chain_dot = _chain(policy, weight), _chain(direction, weight)
    to_go_dot = _to_go_dot(_gains(direction, expected), chain, chain_dot, target, earliest, to_go)
    visits_dot, met_dot = _occupancy_dot(chain, chain_dot, target, earliest, to_go, to_go_dot, occupancy)
    return _of_actions(visits_dot, met_dot, weight, expected)
