"""The loss that episodes make of their policies: advantages, and what they say of each action.

Axes: N tasks, B episodes, T steps, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from torch import Tensor

from merap.learning.config import Baseline
from merap.learning.episodes import Episodes
from merap.learning.kernels import Array, Arrays, compiled

# The time unit of rllab's LinearFeatureBaseline, whose features are t, t^2, t^3 and 1 beside the state.
TIME_UNIT = 100
# Equal advantages carry nothing but rounding errors; those must not be blown up.
LEAST_DEVIATION = 1e-3


@dataclass(frozen=True)
class AdvantageRule:
    """How advantages are made.

    Attributes:
        discount: in [0, 1].
        gae_lambda: in [0, 1]; of generalised advantage estimation (Schulman et al. 2016, eq. 16).
        baseline: see `baseline_values`.
        ridge: regularisation of the linear baseline, positive.
        variance: of the advantages in training.
        variance_weight: that variance counts as this many episodes; 0: not at all.
    """

    discount: float
    gae_lambda: float
    baseline: Baseline
    ridge: float
    variance: float
    variance_weight: float


@dataclass(frozen=True, eq=False)
class Surrogate:
    """The loss -mean over active steps of log pi(a | s) times the normalised advantage, of each task.

    Attributes:
        gradient: float [N, S, A], in log pi.
        scale: float [N], turns an expected advantage into a term of the loss.
        variance: float64 [N], of the advantages, before it is averaged with that of training.
    """

    gradient: Tensor
    scale: Tensor
    variance: Tensor


@torch.no_grad()
def surrogate(
    episodes: Episodes, rule: AdvantageRule, shape: torch.Size, blame: Tensor | None = None
) -> Surrogate:
    """Return the loss of episodes.

    Args:
        episodes: N x B of them.
        rule: how advantages are made.
        shape: of the policies, [N, S, A].
        blame: float [N, S, A], weight of a step with a negative advantage; None: 1.
    """
    advantage = advantages(episodes, shape[1], rule)
    steps, of_steps = episodes.arrays, advantage.contiguous().numpy()
    mean, variance, unit = np.zeros((3, shape[0]))
    _moments(of_steps, steps[-1], (rule.variance, rule.variance_weight), mean, variance, unit)
    gradient = torch.zeros(shape, dtype=advantage.dtype)
    weight = np.ones(shape, dtype=of_steps.dtype) if blame is None else blame.contiguous().numpy()
    _add_up(steps, of_steps, mean, unit, weight, gradient.numpy())
    scale = torch.from_numpy(episodes.state.shape[1] / unit).to(advantage.dtype)
    return Surrogate(gradient, scale, torch.from_numpy(variance))


def advantages(episodes: Episodes, num_states: int, rule: AdvantageRule) -> Tensor:
    """Generalised advantage estimation, float [N, B, T], 0 where inactive.

    sum over u >= t of (discount gae_lambda)^(u - t) (r_u + discount V_u+1 - V_u).
    """
    to_go = discounted_sums(episodes.reward, rule.discount)
    values = baseline_values(episodes, to_go, num_states, rule.baseline, rule.ridge)
    if rule.gae_lambda == 1:  # the terms' values cancel each other
        return to_go - values
    ahead = torch.nn.functional.pad(values[..., 1:], (0, 1))
    return discounted_sums(episodes.reward + rule.discount * ahead - values, rule.discount * rule.gae_lambda)


def discounted_sums(terms: Tensor, discount: float) -> Tensor:
    """sum over u >= t of discount^(u - t) terms_u, float [N, B, T]; of rewards, the returns-to-go."""
    sums = terms.clone(memory_format=torch.contiguous_format)
    _discount(sums.numpy(), discount)
    return sums


def baseline_values(
    episodes: Episodes, to_go: Tensor, num_states: int, baseline: Baseline, ridge: float
) -> Tensor:
    """Return the returns-to-go that were to be expected, fitted to the episodes of each task.

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
        count = episodes.active.sum(dim=1, keepdim=True).clamp_min(1)
        return (to_go * episodes.active).sum(dim=1, keepdim=True) / count * episodes.active
    return torch.zeros_like(to_go)


def _linear_baseline(episodes: Episodes, to_go: Tensor, num_states: int, ridge: float) -> Tensor:
    """The states' block of the normal equations is diagonal: eliminating it leaves 4 equations."""
    num_tasks, _, horizon = to_go.shape
    time, steps = _time_features(horizon), episodes.arrays
    in_state, by_time = np.zeros((num_tasks, num_states, 5)), np.zeros((num_tasks, horizon, 2))
    _step_sums(steps, to_go.contiguous().numpy(), time, in_state, by_time)
    matrix, right = np.zeros((num_tasks, 4, 4)), np.zeros((num_tasks, 4, 1))
    _normal_equations(in_state, by_time, time, ridge, matrix, right)
    fitted = torch.zeros_like(to_go, memory_format=torch.contiguous_format)
    _fit(steps, in_state, np.linalg.solve(matrix, right), time, ridge, fitted.numpy())
    return fitted


@cache
def _time_features(horizon: int) -> Array:
    """float64 [T, 4]."""
    time = np.arange(horizon) / TIME_UNIT
    return np.stack([time, time**2, time**3, np.ones_like(time)], axis=1)


@compiled
def _discount(sums: Array, discount: float) -> None:
    """Replace terms [N, B, T] by their discounted sums."""
    for n in range(sums.shape[0]):
        for e in range(sums.shape[1]):
            for t in range(sums.shape[2] - 2, -1, -1):
                sums[n, e, t] += discount * sums[n, e, t + 1]


@compiled
def _step_sums(steps: Arrays, to_go: Array, time: Array, in_state: Array, by_time: Array) -> None:
    """Add up over active steps [N, B, T].

    By state [N, S, 5] the features of time [T, 4] and the returns-to-go; by time [N, T, 2] the number of
    steps and the returns-to-go.
    """
    state, _, _, active = steps
    for n in range(state.shape[0]):
        for e in range(state.shape[1]):
            for t in range(state.shape[2]):
                if active[n, e, t]:
                    s = state[n, e, t]
                    by_time[n, t, 0] += 1
                    by_time[n, t, 1] += to_go[n, e, t]
                    in_state[n, s, 4] += to_go[n, e, t]
                    for i in range(4):
                        in_state[n, s, i] += time[t, i]


@compiled
def _normal_equations(
    in_state: Array, by_time: Array, time: Array, ridge: float, matrix: Array, right: Array
) -> None:
    """Fill those of the features of time [N, 4, 4] and [N, 4, 1], with the states' eliminated."""
    for n in range(len(matrix)):
        for i in range(4):
            matrix[n, i, i] = ridge
            for t in range(len(time)):
                right[n, i, 0] += time[t, i] * by_time[n, t, 1]
                for j in range(4):
                    matrix[n, i, j] += by_time[n, t, 0] * time[t, i] * time[t, j]
            for s in range(in_state.shape[1]):
                part = in_state[n, s, i] / (in_state[n, s, 3] + ridge)
                right[n, i, 0] -= part * in_state[n, s, 4]
                for j in range(4):
                    matrix[n, i, j] -= part * in_state[n, s, j]


@compiled
def _fit(steps: Arrays, in_state: Array, of_time: Array, time: Array, ridge: float, fitted: Array) -> None:
    """Fill the fitted values of active steps [N, B, T], by the coefficients of time [N, 4, 1]."""
    state, _, _, active = steps
    for n in range(state.shape[0]):
        for e in range(state.shape[1]):
            for t in range(state.shape[2]):
                if active[n, e, t]:
                    s = state[n, e, t]
                    value, left = 0.0, in_state[n, s, 4]
                    for i in range(4):
                        value += time[t, i] * of_time[n, i, 0]
                        left -= in_state[n, s, i] * of_time[n, i, 0]
                    fitted[n, e, t] = value + left / (in_state[n, s, 3] + ridge)


@compiled
def _moments(
    advantage: Array, active: Array, before: tuple[float, float], mean: Array, variance: Array, unit: Array
) -> None:
    """Fill the mean and variance [N] of the advantages of active steps [N, B, T], and their unit [N].

    It is the standard deviation, averaged with the variance and weight before, times the number of steps.
    """
    num_tasks, num_episodes, horizon = active.shape
    for n in range(num_tasks):
        count, total, squares = 0.0, 0.0, 0.0
        for e in range(num_episodes):
            for t in range(horizon):
                if active[n, e, t]:
                    count += 1
                    total += advantage[n, e, t]
                    squares += advantage[n, e, t] ** 2
        count = max(count, 1.0)
        mean[n] = total / count
        variance[n] = max(squares / count - mean[n] ** 2, 0.0)
        shrunk = (num_episodes * variance[n] + before[1] * before[0]) / (num_episodes + before[1])
        unit[n] = (shrunk + LEAST_DEVIATION**2) ** 0.5 * count


@compiled
def _add_up(steps: Arrays, advantage: Array, mean: Array, unit: Array, blame: Array, gradient: Array) -> None:
    """Subtract from a gradient [N, S, A] what advantages are above their mean, in units.

    What is below it takes the blame [N, S, A].
    """
    state, action, _, active = steps
    for n in range(state.shape[0]):
        for e in range(state.shape[1]):
            for t in range(state.shape[2]):
                if active[n, e, t]:
                    s, a = state[n, e, t], action[n, e, t]
                    part = (advantage[n, e, t] - mean[n]) / unit[n]
                    gradient[n, s, a] -= part * blame[n, s, a] if part < 0 else part
