"""What episodes say of their policies: advantages and the surrogate loss."""

from __future__ import annotations

from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from merap.learning.core.episodes import Episodes, discounted_sums
from merap.learning.core.jit import Array, Bools, Numbers, compiled

Baseline = Literal["linear", "time", "none"]
Shape = tuple[int, ...]

# The time unit of rllab's LinearFeatureBaseline, whose features are t, t^2, t^3 and 1 beside the state.
TIME_UNIT = 100
# Equal advantages carry nothing but rounding errors; those must not be blown up.
LEAST_DEVIATION = 1e-3


class Judgement(NamedTuple):
    """How advantages are made.

    Attributes:
        discount: in [0, 1].
        gae_lambda: in [0, 1]; of generalised advantage estimation (Schulman et al. 2016, eq. 16).
        baseline: see `baseline_values`.
        ridge: regularisation of the linear baseline, positive.
        variance: of the advantages in training.
        variance_weight: that variance counts as so many episodes; 0: not at all.
    """

    discount: float
    gae_lambda: float
    baseline: Baseline
    ridge: float
    variance: float
    variance_weight: float


class Surrogate(NamedTuple):
    """The loss -mean over active steps of log pi(a | s) times the normalised advantage, of each task.

    Attributes:
        gradient: float [N, S, A], in log pi.
        scale: float64 [N], what turns an expected advantage into a term of the loss.
        variance: float64 [N], of the advantages, before it is averaged with that of training.
    """

    gradient: Array
    scale: Array
    variance: Array


def surrogate(episodes: Episodes, blame: Array | None, judgement: Judgement, shape: Shape) -> Surrogate:
    """The loss of episodes.

    Args:
        episodes: N x B of them.
        blame: float [N, S, A], weight of a step with a negative advantage; None: 1.
        judgement: how advantages are made.
        shape: N, S, A.
    """
    advantage = advantages(episodes, shape[1], judgement)
    everything = np.ones((1, 1, 1), dtype=advantage.dtype) if blame is None else blame
    parts = (episodes.state, episodes.action, episodes.active)
    before = (judgement.variance, judgement.variance_weight)
    return Surrogate(*_surrogate(*parts, advantage, np.broadcast_to(everything, shape), *before))


def advantages(episodes: Episodes, num_states: int, judgement: Judgement) -> Array:
    """Generalised advantage estimation, float [N, B, T], 0 where inactive."""
    to_go = discounted_sums(episodes.reward, judgement.discount)
    values = baseline_values(episodes, to_go, num_states, judgement.baseline, judgement.ridge)
    return _advantages(episodes.reward, values, judgement.discount, judgement.gae_lambda)


def baseline_values(
    episodes: Episodes, to_go: Array, num_states: int, baseline: Baseline, ridge: float
) -> Array:
    """What the return-to-go was to be expected to be, fitted to the episodes of each task.

    Args:
        episodes: N x B of them.
        to_go: float [N, B, T], their returns-to-go.
        num_states: S.
        baseline: `time`, the mean at each step; `linear`, ridge regression on the one-hot state and
            t, t^2, t^3, 1 (the linear feature baseline of Duan et al. 2016, section 5.1); `none`, 0.
        ridge: weight of the squared coefficients, positive.

    Returns:
        float [N, B, T], 0 where inactive.
    """
    if baseline == "linear":
        return _linear_baseline(episodes, to_go, num_states, ridge)
    if baseline == "time":
        count = np.maximum(episodes.active.sum(axis=1, keepdims=True), 1)
        mean = (to_go * episodes.active).sum(axis=1, keepdims=True) / count
        values: Array = mean * episodes.active
        return values.astype(to_go.dtype)
    return np.zeros_like(to_go)


def _linear_baseline(episodes: Episodes, to_go: Array, num_states: int, ridge: float) -> Array:
    """The states' block of the normal equations is diagonal: eliminating it leaves 4 equations."""
    state, active, features = episodes.state, episodes.active, _time_features(to_go.shape[2])
    in_state, of_state, counts, of_steps = _step_sums(state, active, to_go, features, num_states)
    matrix, right = _normal_equations(in_state, of_state, counts, of_steps, features, ridge)
    of_time = np.linalg.solve(matrix, right[..., np.newaxis])[..., 0]
    return _fitted(state, active, in_state, of_state, of_time, features, ridge, to_go)


@cache
def _time_features(horizon: int) -> Array:
    """float64 [T, 4]."""
    time = np.arange(horizon) / TIME_UNIT
    return np.stack([time, time**2, time**3, np.ones_like(time)], axis=1)


@compiled
def _advantages(reward: Array, values: Array, discount: float, gae_lambda: float) -> Array:
    """sum over u >= t of (discount gae_lambda)^(u - t) (r_u + discount V_u+1 - V_u)."""
    result = np.empty_like(values)
    num_tasks, num_episodes, horizon = values.shape
    for n in range(num_tasks):
        for b in range(num_episodes):
            ahead = following = 0.0
            for t in range(horizon - 1, -1, -1):
                present = values[n, b, t]
                ahead = reward[n, b, t] + discount * following - present + discount * gae_lambda * ahead
                result[n, b, t] = ahead
                following = present
    return result


@compiled
def _step_sums(
    state: Numbers, active: Bools, to_go: Array, features: Array, num_states: int
) -> tuple[Array, Array, Array, Array]:
    """Sums over active steps: features [N, S, 4], returns-to-go [N, S]; counts and returns by time."""
    num_tasks, num_episodes, horizon = to_go.shape
    in_state, of_state = np.zeros((num_tasks, num_states, 4)), np.zeros((num_tasks, num_states))
    counts, of_steps = np.zeros((num_tasks, horizon)), np.zeros((num_tasks, horizon))
    for n in range(num_tasks):
        for b in range(num_episodes):
            for t in range(horizon):
                if active[n, b, t]:
                    s = state[n, b, t]
                    of_state[n, s] += to_go[n, b, t]
                    counts[n, t] += 1
                    of_steps[n, t] += to_go[n, b, t]
                    for i in range(4):
                        in_state[n, s, i] += features[t, i]
    return in_state, of_state, counts, of_steps


@compiled
def _normal_equations(
    in_state: Array, of_state: Array, counts: Array, of_steps: Array, features: Array, ridge: float
) -> tuple[Array, Array]:
    """Those of the features of time, float64 [N, 4, 4] and [N, 4], with the states' eliminated."""
    num_tasks, num_states, _ = in_state.shape
    matrix, right = np.zeros((num_tasks, 4, 4)), np.zeros((num_tasks, 4))
    for n in range(num_tasks):
        for i in range(4):
            matrix[n, i, i] = ridge
            for t in range(len(features)):
                right[n, i] += features[t, i] * of_steps[n, t]
                for j in range(4):
                    matrix[n, i, j] += counts[n, t] * features[t, i] * features[t, j]
            for s in range(num_states):
                part = in_state[n, s, i] / (in_state[n, s, 3] + ridge)
                right[n, i] -= part * of_state[n, s]
                for j in range(4):
                    matrix[n, i, j] -= part * in_state[n, s, j]
    return matrix, right


@compiled
def _fitted(
    state: Numbers,
    active: Bools,
    in_state: Array,
    of_state: Array,
    of_time: Array,
    features: Array,
    ridge: float,
    to_go: Array,
) -> Array:
    """What the coefficients of time [N, 4], and those of the states that go with them, make of each step."""
    fitted = np.zeros_like(to_go)
    num_tasks, num_episodes, horizon = to_go.shape
    of_each, trend = np.zeros_like(of_state), np.zeros((num_tasks, horizon))
    for n in range(num_tasks):
        for s in range(of_state.shape[1]):
            left = of_state[n, s]
            for i in range(4):
                left -= in_state[n, s, i] * of_time[n, i]
            of_each[n, s] = left / (in_state[n, s, 3] + ridge)
        for t in range(horizon):
            for i in range(4):
                trend[n, t] += features[t, i] * of_time[n, i]
        for b in range(num_episodes):
            for t in range(horizon):
                if active[n, b, t]:
                    fitted[n, b, t] = of_each[n, state[n, b, t]] + trend[n, t]
    return fitted


@compiled
def _moments(advantage: Array, active: Bools) -> tuple[Array, Array, Array]:
    """Number of active steps, at least 1, the mean of their advantages and the variance, float64 [N]."""
    num_tasks, num_episodes, horizon = active.shape
    count, mean, variance = np.zeros(num_tasks), np.zeros(num_tasks), np.zeros(num_tasks)
    for n in range(num_tasks):
        steps, total, squares = 0, 0.0, 0.0
        for b in range(num_episodes):
            for t in range(horizon):
                if active[n, b, t]:
                    steps += 1
                    total += advantage[n, b, t]
        count[n] = max(steps, 1)
        mean[n] = total / count[n]
        for b in range(num_episodes):
            for t in range(horizon):
                if active[n, b, t]:
                    squares += (advantage[n, b, t] - mean[n]) ** 2
        variance[n] = squares / count[n]
    return count, mean, variance


@compiled
def _summed_up(
    state: Numbers,
    action: Numbers,
    active: Bools,
    advantage: Array,
    mean: Array,
    scale: Array,
    blame: Array,
) -> Array:
    """float [N, S, A]: minus the sum of scale times what advantages are above their mean.

    What is below it takes the blame.
    """
    total = np.zeros(blame.shape, dtype=advantage.dtype)
    for n in range(state.shape[0]):
        for b in range(state.shape[1]):
            for t in range(state.shape[2]):
                if active[n, b, t]:
                    s, a = state[n, b, t], action[n, b, t]
                    part = scale[n] * (advantage[n, b, t] - mean[n])
                    total[n, s, a] -= part * blame[n, s, a] if part < 0 else part
    return total


@compiled
def _surrogate(
    state: Numbers,
    action: Numbers,
    active: Bools,
    advantage: Array,
    blame: Array,
    variance_before: float,
    weight_before: float,
) -> tuple[Array, Array, Array]:
    """Gradient, scale and variance of `Surrogate`; as many episodes as the weight had a variance before."""
    count, mean, variance = _moments(advantage, active)
    num_episodes = active.shape[1]
    shrunk = (num_episodes * variance + weight_before * variance_before) / (num_episodes + weight_before)
    unit = np.sqrt(shrunk + LEAST_DEVIATION**2) * count
    gradient = _summed_up(state, action, active, advantage, mean, 1 / unit, blame)
    return gradient, num_episodes / unit, variance
