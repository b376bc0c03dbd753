"""The tabular recursions, compiled: values, visits, Hessian products.

They loop over tasks and states, allocate nothing and call nothing but one another, which keeps their first
compilation short. All that they fill is given to them; floats are all of one precision. No GIL is held.

Axes: N tasks, S states, A actions, B branches of all tasks, M branches of one task, H steps of the longest
horizon. The arrays of tasks are those of `TaskBatch.arrays`: first int64 [N, S A + 1] and ends int64
[N, S + 1], where the branches of choices and states begin; target uint32 [B]; weight float [B], discounted
probability to go on; expected float [N, S, A], rewards; earliest int32 [N, S], first time in a state; horizon
int64 [N]; initial float [N, S].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
Numbers = npt.NDArray[np.int64]
Arrays = tuple[npt.NDArray[Any], ...]
Function = TypeVar("Function", bound=Callable[..., object])

# A fixed point is found to this accuracy, relative to its largest value; single precision allows no more.
ACCURACY, SINGLE_ACCURACY = 1e-13, 1e-7
MOST_SWEEPS = 10_000_000


def compiled(function: Function) -> Function:
    """Compile a function; the result is kept on disk beside the source, or in the user's cache."""
    return cast("Function", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


@compiled
def follow(policy: Array, first: Numbers, weight: Array, expected: Array, chain: Array, gains: Array) -> None:
    """Fill the chain [M] and the expected rewards [S] of a policy [S, A] on one task."""
    num_states, num_actions = policy.shape
    for s in range(num_states):
        gain = policy[s, 0] * expected[s, 0]
        for a in range(num_actions):
            choice = s * num_actions + a
            if a > 0:
                gain += policy[s, a] * expected[s, a]
            for b in range(first[choice], first[choice + 1]):
                chain[b - first[0]] = policy[s, a] * weight[b]
        gains[s] = gain


@compiled
def collect(
    first: Numbers, weight: Array, expected: Array, visits: Array, met: Array, gradient: Array
) -> None:
    """Fill dJ/dpi [S, A] of one task from visits [S] and the sums over time of d_t(s) V(target) [M]."""
    num_states, num_actions = gradient.shape
    for s in range(num_states):
        for a in range(num_actions):
            choice = s * num_actions + a
            total = visits[s] * expected[s, a]
            for b in range(first[choice], first[choice + 1]):
                total += weight[b] * met[b - first[0]]
            gradient[s, a] = total


@compiled
def begin(initial: Array, values: Array, occupancy: Array) -> Any:
    """Fill the occupancy [S] at time 0, and return the mean of values [S] there."""
    total = initial[0] * values[0]
    occupancy[0] = initial[0]
    for s in range(1, len(initial)):
        total += initial[s] * values[s]
        occupancy[s] = initial[s]
    return total


@compiled
def evaluate(policy: Array, tasks: Arrays, found: Arrays, chain: Array, met: Array) -> None:
    """Evaluate policies [N, S, A] over the tasks' horizons.

    Filled are values to go and occupancies [N, H + 1, S], zeros before, visits [N, S], J [N] and dJ/dpi
    [N, S, A]; chain and met [M] are scratch.
    """
    first, ends, target, weight, expected, earliest, horizon, initial = tasks
    to_go, occupancy, visits, total, gradient = found
    num_tasks, num_states, _ = policy.shape
    for n in range(num_tasks):
        end, targets, gains = horizon[n], target[first[n, 0] :], visits[n]  # gains until visits are counted
        follow(policy[n], first[n], weight, expected[n], chain, gains)
        for h in range(end):
            before, after = to_go[n, h], to_go[n, h + 1]
            last = 0
            for s in range(num_states):
                start, last = last, ends[n, s + 1] - ends[n, 0]
                if earliest[n, s] < end - h:
                    value = gains[s]
                    for b in range(start, last):
                        value += chain[b] * before[targets[b]]
                    after[s] = value
        visits[n].fill(0)
        met.fill(0)
        total[n] = begin(initial[n], to_go[n, end], occupancy[n, 0])
        for t in range(end):
            present, following, ahead = occupancy[n, t], occupancy[n, t + 1], to_go[n, end - 1 - t]
            last = 0
            for s in range(num_states):
                start, last = last, ends[n, s + 1] - ends[n, 0]
                mass = present[s]
                if mass != 0:
                    visits[n, s] += mass
                    for b in range(start, last):
                        met[b] += mass * ahead[targets[b]]
                        following[targets[b]] += mass * chain[b]
        collect(first[n], weight, expected[n], visits[n], met, gradient[n])


@compiled
def hessian_product(
    policy: Array, direction: Array, tasks: Arrays, found: Arrays, product: Array, scratch: Arrays
) -> None:
    """Fill the product of the Hessian of J with a direction [N, S, A]: the derivative of `evaluate` along it.

    What was found are the values to go and occupancies of the policy; scratch is [3, M] and [H + 5, S].
    """
    first, ends, target, weight, expected, earliest, horizon, _ = tasks
    to_go, occupancy = found
    links, rows = scratch
    chain, chain_dot, met_dot = (
        links[0],
        links[1],
        links[2],
    )  # to unpack them would forget that they are contiguous
    gains_dot, visits_dot, to_go_dot = rows[0], rows[1], rows[4:]
    num_tasks, num_states, _ = policy.shape
    for n in range(num_tasks):
        end, targets = horizon[n], target[first[n, 0] :]
        follow(policy[n], first[n], weight, expected[n], chain, gains_dot)
        follow(direction[n], first[n], weight, expected[n], chain_dot, gains_dot)
        to_go_dot.fill(0)
        for h in range(end - 1):
            before, before_dot, after_dot = to_go[n, h], to_go_dot[h], to_go_dot[h + 1]
            last = 0
            for s in range(num_states):
                start, last = last, ends[n, s + 1] - ends[n, 0]
                if earliest[n, s] < end - h:
                    value = gains_dot[s]
                    for b in range(start, last):
                        value += chain_dot[b] * before[targets[b]] + chain[b] * before_dot[targets[b]]
                    after_dot[s] = value
        met_dot.fill(0)
        visits_dot.fill(0)
        rows[2].fill(0)
        for t in range(end):
            present_dot, following_dot = rows[2 + t % 2], rows[2 + (t + 1) % 2]
            following_dot.fill(0)
            ahead, ahead_dot = to_go[n, end - 1 - t], to_go_dot[end - 1 - t]
            last = 0
            for s in range(num_states):
                start, last = last, ends[n, s + 1] - ends[n, 0]
                mass, mass_dot = occupancy[n, t, s], present_dot[s]
                if mass != 0 or mass_dot != 0:
                    visits_dot[s] += mass_dot
                    for b in range(start, last):
                        to = targets[b]
                        met_dot[b] += mass_dot * ahead[to] + mass * ahead_dot[to]
                        following_dot[to] += mass_dot * chain[b] + mass * chain_dot[b]
        collect(first[n], weight, expected[n], visits_dot, met_dot, product[n])


@compiled
def solve_values(ends: Numbers, targets: Array, chain: Array, gains: Array, values: Array) -> None:
    """Find the fixed point V = gains + C V [S] of one task, by Gauss-Seidel sweeps in alternating order."""
    accuracy = ACCURACY if values.itemsize == 8 else SINGLE_ACCURACY
    for sweep in range(MOST_SWEEPS):
        change = size = 0.0
        for i in range(len(values)):
            s = i if sweep % 2 else len(values) - 1 - i
            value = gains[s]
            for b in range(ends[s], ends[s + 1]):
                value += chain[b] * values[targets[b]]
            change = max(change, abs(value - values[s]))
            size = max(size, abs(value))
            values[s] = value
        if change <= accuracy * size:
            break


@compiled
def solve_visits(ends: Numbers, targets: Array, chain: Array, arrivals: Array, visits: Array) -> None:
    """Find the fixed point d = arrivals + C' d [S] of one task, by pushing on arrivals, which are used up."""
    accuracy = ACCURACY if visits.itemsize == 8 else SINGLE_ACCURACY
    for sweep in range(MOST_SWEEPS):
        pushed = size = 0.0
        for i in range(len(visits)):
            s = len(visits) - 1 - i if sweep % 2 else i
            mass = arrivals[s]
            if mass != 0:
                arrivals[s] = 0
                visits[s] += mass
                pushed = max(pushed, abs(mass))
                for b in range(ends[s], ends[s + 1]):
                    arrivals[targets[b]] += mass * chain[b]
            size = max(size, abs(visits[s]))
        if pushed <= accuracy * size:
            break
