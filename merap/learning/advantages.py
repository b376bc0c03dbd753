"""From rewards to advantages: returns-to-go, baselines, generalised advantage estimation.

Axes: N tasks, B episodes, T steps, S states.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from merap.learning.rollout import Episodes

Baseline = Literal["linear", "time", "none"]

# The time unit of rllab's LinearFeatureBaseline, whose features are t, t^2, t^3 and 1 beside the state.
_TIME_UNIT = 100


def discounted_sums(terms: Tensor, discount: float) -> Tensor:
    """sum over u >= t of discount^(u - t) terms_u; of rewards these are the returns-to-go.

    Args:
        terms: float [..., T].
        discount: in [0, 1].

    Returns:
        float [..., T].
    """
    step = torch.arange(terms.shape[-1])
    ahead = (step.unsqueeze(1) - step).clamp_min(0)  # [u, t]
    return terms @ (discount ** ahead.to(terms.dtype)).tril()


def baseline_values(
    episodes: Episodes, to_go: Tensor, num_states: int, baseline: Baseline, ridge: float
) -> Tensor:
    """What the return-to-go was to be expected to be, fitted to the episodes of each task.

    Args:
        episodes: N x B episodes.
        to_go: float [N, B, T], their returns-to-go.
        num_states: S.
        baseline: `time`, the mean at each step; `linear`, by `linear_baseline`; `none`, 0.
        ridge: of the linear baseline.

    Returns:
        float [N, B, T], 0 where inactive.
    """
    weight = episodes.active.to(to_go.dtype)
    if baseline == "linear":
        return linear_baseline(episodes, to_go, num_states, ridge) * weight
    if baseline == "time":
        mean = (to_go * weight).sum(dim=1, keepdim=True) / weight.sum(dim=1, keepdim=True).clamp_min(1)
        return mean * weight
    return torch.zeros_like(to_go)


def linear_baseline(episodes: Episodes, to_go: Tensor, num_states: int, ridge: float) -> Tensor:
    """Ridge regression of the return-to-go on the one-hot state and t, t^2, t^3, 1.

    The linear feature baseline of Duan et al. (2016, section 5.1) for one-hot states. There
    the states' block of the normal equations is diagonal: eliminating it leaves 4 equations.

    Args:
        episodes: N x B episodes.
        to_go: float [N, B, T].
        num_states: S.
        ridge: weight of the squared coefficients, positive.

    Returns:
        float [N, B, T]; means nothing where inactive.
    """
    num_tasks, _, horizon = to_go.shape
    time = torch.arange(horizon, dtype=torch.float64) / _TIME_UNIT
    features = torch.stack([time, time**2, time**3, torch.ones_like(time)], dim=-1)  # [T, 4]
    weight = episodes.active.double()
    target = to_go.double() * weight
    row = (episodes.state + torch.arange(num_tasks).view(-1, 1, 1) * num_states).flatten()

    def by_state(values: Tensor) -> Tensor:
        return torch.bincount(row, values.flatten(), num_tasks * num_states).view(num_tasks, num_states)

    per_state = torch.stack([by_state(weight * feature) for feature in features.T], dim=-1)  # [N, S, 4]
    of_target = by_state(target).unsqueeze(-1)  # [N, S, 1]
    count = per_state[..., 3:] + ridge  # the last feature is 1
    scaled = per_state / count
    squares = (features.T * weight.sum(dim=1, keepdim=True)) @ features  # [N, 4, 4]
    matrix = squares + ridge * torch.eye(4, dtype=torch.float64) - scaled.mT @ per_state
    right = features.T @ target.sum(dim=1).unsqueeze(-1) - scaled.mT @ of_target
    of_time: Tensor = torch.linalg.solve(matrix, right)  # [N, 4, 1]
    of_state = (of_target - per_state @ of_time) / count  # [N, S, 1]
    fitted = of_state.take(row).view_as(to_go) + (features @ of_time).mT
    return fitted.to(to_go.dtype)


def advantages(episodes: Episodes, values: Tensor, discount: float, gae_lambda: float) -> Tensor:
    """Generalised advantage estimation (Schulman et al. 2016, eq. 16).

    Args:
        episodes: N x B episodes.
        values: float [N, B, T], the baseline, 0 where inactive.
        discount: in [0, 1].
        gae_lambda: in [0, 1]; 1 gives the return-to-go minus the baseline.

    Returns:
        float [N, B, T], 0 where inactive.
    """
    following = torch.nn.functional.pad(values[..., 1:], (0, 1))
    residual = episodes.reward + discount * following - values
    return discounted_sums(residual, discount * gae_lambda) * episodes.active
