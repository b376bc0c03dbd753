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
    weight = episodes.active.flatten(1).double()  # [N, B * T]
    target = to_go.flatten(1).double() * weight
    time = torch.arange(horizon, dtype=torch.float64) / _TIME_UNIT
    features = torch.stack([time, time**2, time**3, torch.ones_like(time)], dim=-1)  # [T, 4]
    rows = features.expand(to_go.shape[1], -1, -1).flatten(0, 1) * weight.unsqueeze(-1)  # [N, B * T, 4]
    state = episodes.state.flatten(1)
    known = torch.cat([rows, target.unsqueeze(-1), weight.unsqueeze(-1)], dim=-1)
    index = state.unsqueeze(-1).expand_as(known)
    sums = torch.zeros(num_tasks, num_states, 6, dtype=torch.float64).scatter_add_(1, index, known)
    per_state, of_target, count = sums[..., :4], sums[..., 4:5], sums[..., 5:]
    scaled = per_state / (count + ridge)  # [N, S, 4]
    matrix = rows.mT @ rows + ridge * torch.eye(4, dtype=torch.float64) - scaled.mT @ per_state
    right = rows.mT @ target.unsqueeze(-1) - scaled.mT @ of_target
    of_time = torch.linalg.solve(matrix, right)  # [N, 4, 1]
    of_state = (of_target - per_state @ of_time) / (count + ridge)  # [N, S, 1]
    fitted = of_state.squeeze(-1).gather(1, state) + (rows @ of_time).squeeze(-1)
    return fitted.view_as(to_go).to(to_go.dtype)


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


def normalised(advantage: Tensor, active: Tensor) -> tuple[Tensor, Tensor]:
    """Advantages of mean 0 and standard deviation 1 over the active steps of each task.

    Args:
        advantage: float [N, B, T], 0 where inactive.
        active: bool [N, B, T].

    Returns:
        The normalised advantages, float [N, B, T], 0 where inactive; and what they were
        divided by, float [N].
    """
    weight = active.to(advantage.dtype)
    count = weight.sum(dim=(1, 2), keepdim=True).clamp_min(1)
    centred = (advantage - advantage.sum(dim=(1, 2), keepdim=True) / count) * weight
    deviation = (centred.square().sum(dim=(1, 2), keepdim=True) / count).sqrt()
    # Equal advantages carry nothing but rounding errors; those must not be blown up.
    scale = deviation + 1e-3
    return centred / scale, scale.flatten()
