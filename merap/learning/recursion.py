"""The recursions behind the exact value of a policy, in numpy and scipy.

The value of a policy pi on a known MDP over T steps is J = initial' V_T with

    V_h = r_pi + C V_h-1,  V_0 = 0,   C(s, s') = gamma sum_a pi(s, a) P(s, a, s')

with h steps to go, where C leaves out what enters a completed state. Its gradient is
dJ/dpi(s, a) = sum_t d_t(s) Q_T-t(s, a) with the discounted probability d_t+1 = C' d_t to be
in s at time t (Sutton et al. 2000, theorem 1). The product of the Hessian with a direction
is the derivative of both recursions along that direction.

Written out by hand, because automatic differentiation of the unrolled loop takes several times as long and
stores T numbers per branch instead of T per state. Sparse products are scipy's, which are
twice as fast here as gathers in torch.

Axes: S states of all tasks in one row (N times the states of one), A actions, K successors,
M = A K branches of a state, T steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

Array = npt.NDArray[np.floating]

# The successors' values of a block of states should fit into the processor's cache.
_BLOCK_NUMEL = 2**17


@dataclass(frozen=True, eq=False)
class Problem:
    """Several tasks as one MDP; floats are all of one precision.

    Attributes:
        weight: float [S, A, K], discounted probability to go on in a successor.
        reward: float [S, A], expected.
        successor: int32 [S, M], index into S.
        row_pointers: int32 [S + 1], multiples of M.
        initial: float [S].
        horizon: T.
    """

    weight: Array
    reward: Array
    successor: npt.NDArray[np.int32]
    row_pointers: npt.NDArray[np.int32]
    initial: Array
    horizon: int


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A policy as a chain, and what it is worth.

    Attributes:
        chain: C, sparse [S, S].
        values: float [T + 1, S], V_h with h steps to go.
    """

    chain: csr_array
    values: Array


def evaluate(policy: Array, problem: Problem) -> Evaluation:
    """The values of a policy, float [S, A] with 0 for disabled actions."""
    chain = _chain(policy, problem)
    return Evaluation(chain, _values(chain, _gains(policy, problem), problem))


def occupancies(evaluation: Evaluation, problem: Problem) -> Array:
    """float [T, S]: d_t, the discounted probability to be in a state at time t."""
    return _occupancies(evaluation.chain, problem)


def gradient(evaluation: Evaluation, occupancy: Array, problem: Problem) -> Array:
    """float [S, A]: dJ/dpi."""
    visits: Array = occupancy.sum(axis=0)[:, np.newaxis]
    return problem.reward * visits + _future([(occupancy, evaluation.values)], problem)


def hessian_product(evaluation: Evaluation, occupancy: Array, direction: Array, problem: Problem) -> Array:
    """float [S, A]: the Hessian of J with respect to pi times a direction [S, A].

    With a dot for the derivative along the direction,
    V._h = r. + C. V_h-1 + C V._h-1 from V._0 = 0, and d._t+1 = C.' d_t + C' d._t from d._0 = 0.
    """
    turn = _chain(direction, problem)
    gains = _gains(direction, problem) + (turn @ evaluation.values[:-1].T).T
    values_dot = _values(evaluation.chain, gains, problem)
    arrivals = (turn.T @ occupancy[:-1].T).T
    occupancy_dot = _occupancies(evaluation.chain, problem, arrivals)
    visits_dot: Array = occupancy_dot.sum(axis=0)[:, np.newaxis]
    pairs = [(occupancy_dot, evaluation.values), (occupancy, values_dot)]
    return problem.reward * visits_dot + _future(pairs, problem)


def _chain(policy: Array, problem: Problem) -> csr_array:
    """C [S, S] of a policy, linear in it; a state has M entries, some may be 0 or share a column."""
    data = (policy[:, :, np.newaxis] * problem.weight).ravel()
    shape = (len(policy), len(policy))
    return csr_array((data, problem.successor.ravel(), problem.row_pointers), shape=shape)


def _gains(policy: Array, problem: Problem) -> Array:
    """[S]: expected reward of a step."""
    gains: Array = np.einsum("sa,sa->s", policy, problem.reward)
    return gains


def _values(chain: csr_array, gains: Array, problem: Problem) -> Array:
    """[T + 1, S] of gains [S], or [T, S] if they depend on the steps to go."""
    result = np.zeros((problem.horizon + 1, chain.shape[0]), dtype=problem.reward.dtype)
    per_step = np.broadcast_to(gains, (problem.horizon, chain.shape[0]))
    for h in range(problem.horizon):
        np.add(per_step[h], chain @ result[h], out=result[h + 1])
    return result


def _occupancies(chain: csr_array, problem: Problem, arrivals: Array | None = None) -> Array:
    """[T, S] from the initial distribution; or from 0 with `arrivals` [T - 1, S] at 1, 2, ..."""
    result = np.zeros((problem.horizon, chain.shape[0]), dtype=problem.reward.dtype)
    if arrivals is None:
        result[0] = problem.initial
    else:
        result[1:] = arrivals
    backwards = chain.T
    for t in range(problem.horizon - 1):
        result[t + 1] += backwards @ result[t]
    return result


def _future(pairs: Sequence[tuple[Array, Array]], problem: Problem) -> Array:
    """[S, A]: sum over t and k of d_t(s) weight(s, a, k) V_T-1-t(s'_k).

    Args:
        pairs: occupancies [T, S] and values [T + 1, S]; their sums are added up.
        problem: the tasks.
    """
    # State-major, so that the values of a successor over time are one piece of memory.
    present = np.concatenate([occupancy for occupancy, _ in pairs]).T.copy()
    to_go = np.concatenate([of_values[-2::-1] for _, of_values in pairs]).T.copy()
    total = np.empty_like(problem.weight)
    for block in _blocks(len(present), problem.successor.shape[1], present.shape[1]):
        following = to_go.take(problem.successor[block], axis=0)
        met = np.einsum("smt,st->sm", following, present[block])
        total[block] = met.reshape(total[block].shape)
    future: Array = np.einsum("sak,sak->sa", total, problem.weight)
    return future


def _blocks(num_states: int, num_branches: int, horizon: int) -> Iterator[slice]:
    size = max(1, _BLOCK_NUMEL // (num_branches * horizon))
    return (slice(start, start + size) for start in range(0, num_states, size))
