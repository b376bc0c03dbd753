"""Episodes of many tasks, sampled on their arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from merap.learning.core.jit import Array, Bools, Numbers, Successors, compiled
from merap.learning.core.task import Tasks


class Episodes(NamedTuple):
    """Episodes of N tasks; steps after an end are inactive and have reward 0.

    Attributes:
        state: int64 [N, B, T], where the step began.
        action: int64 [N, B, T]; means nothing where inactive.
        reward: float [N, B, T].
        active: bool [N, B, T], the step was taken.
    """

    state: Numbers
    action: Numbers
    reward: Array
    active: Bools


def rollout(policy: Array, tasks: Tasks, draws: Array) -> Episodes:
    """The episodes of policies that draws lead to, by inversion.

    Args:
        policy: float [N, S, A], a distribution over the enabled actions, 0 at the others.
        tasks: N of them.
        draws: float [N, B, T + 1] in [0, 1): of the initial state, then one for action and successor
            of each step.
    """
    arrays = (tasks.prob, tasks.reward, tasks.successor, tasks.live, tasks.initial)
    return Episodes(*_rollout(policy, *arrays, draws))


def mean_return(episodes: Episodes, discount: float) -> Array:
    """float64 [N], mean discounted return."""
    factors = discount ** np.arange(episodes.reward.shape[-1])
    mean: Array = (episodes.reward @ factors).mean(axis=1)
    return mean


def visits(episodes: Episodes, num_states: int) -> Array:
    """float [N, S], share of the active steps that began in a state."""
    return _visits(episodes.state, episodes.active, num_states, episodes.reward)


def discounted_sums(terms: Array, discount: float) -> Array:
    """sum over u >= t of discount^(u - t) terms_u, float [N, B, T]; of rewards, the returns-to-go."""
    return _discounted_sums(terms.reshape(-1, terms.shape[-1]), discount).reshape(terms.shape)


@compiled
def _rollout(
    policy: Array,
    prob: Array,
    reward: Array,
    successor: Successors,
    live: Bools,
    initial: Array,
    draws: Array,
) -> tuple[Numbers, Numbers, Array, Bools]:
    """State, action, reward and activity [N, B, T]."""
    shape = (len(policy), draws.shape[1], draws.shape[2] - 1)
    state, action = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    earned, active = np.zeros(shape, dtype=policy.dtype), np.zeros(shape, dtype=np.bool_)
    for n in range(shape[0]):
        starts = np.cumsum(initial[n])
        starts /= starts[-1]
        for b in range(shape[1]):
            s = np.int64(np.searchsorted(starts, draws[n, b, 0], side="right"))
            for t in range(shape[2]):
                state[n, b, t] = s
                if live[n, s]:
                    a, left = _drawn(policy[n, s], np.float64(draws[n, b, t + 1]))
                    k, _ = _drawn(prob[n, s, a], left)
                    action[n, b, t], active[n, b, t] = a, True
                    earned[n, b, t] = reward[n, s, a, k]
                    s = np.int64(successor[n, s, a, k])
    return state, action, earned, active


@compiled
def _drawn(shares: Array, draw: float) -> tuple[int, float]:
    """The outcome that a draw in [0, 1) falls on, and where within it the draw lies, in [0, 1).

    The last outcome of positive probability stands where rounding leaves a draw over.
    """
    drawn = 0
    for other in range(len(shares)):
        if shares[other] > 0:
            drawn = other
            if draw < shares[other]:
                return drawn, draw / shares[other]
            draw -= shares[other]
    return drawn, 0.0


@compiled
def _visits(state: Numbers, active: Bools, num_states: int, like: Array) -> Array:
    """Shares of the precision of another array."""
    shares = np.zeros((len(state), num_states), dtype=like.dtype)
    for n in range(state.shape[0]):
        counts = np.zeros(num_states)
        for b in range(state.shape[1]):
            for t in range(state.shape[2]):
                if active[n, b, t]:
                    counts[state[n, b, t]] += 1
        shares[n] = counts / max(counts.sum(), 1.0)
    return shares


@compiled
def _discounted_sums(terms: Array, discount: float) -> Array:
    sums = np.empty_like(terms)
    num_rows, horizon = terms.shape
    for row in range(num_rows):
        ahead = 0.0
        for t in range(horizon - 1, -1, -1):
            ahead = terms[row, t] + discount * ahead
            sums[row, t] = ahead
    return sums
