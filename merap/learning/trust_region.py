"""Trust region policy optimisation of the meta policy (Schulman et al. 2015), through the inner steps.

The step is the natural gradient F^-1 g, as long as the mean KL divergence between the adapted
policies before and after allows, and shortened until the objective really improves. F is the Hessian of
that divergence; it is applied, never stored.

Axes: P parameters in one row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from scipy.sparse.linalg import LinearOperator, cg
from torch import Tensor

from merap.learning.config import TrainingConfig
from merap.learning.drawing import Drawn
from merap.learning.objective import OuterObjective


@dataclass(frozen=True, eq=False)
class TrustRegionStep:
    """Where a step led to.

    Attributes:
        theta: float [P], after it; the same as before if no length was accepted.
        kl: mean divergence of the adapted policies, in nats.
        length: part of the longest step that the divergence allows; 0: none was accepted.
    """

    theta: Tensor
    kl: float
    length: float


def trust_region_step(
    objective: OuterObjective,
    theta: Tensor,
    log_sizes: Tensor,
    gradient: Tensor,
    drawn: Sequence[Drawn],
    config: TrainingConfig,
) -> TrustRegionStep:
    """Take one step from a gradient of the objective, with what was drawn for it.

    Args:
        objective: what is to be improved.
        theta: float [P], entries that count.
        log_sizes: float [2 L].
        gradient: float [P], of the objective in theta.
        drawn: what it was made from.
        config: the bound on the divergence, and how it is searched.
    """
    product = objective.curvature(theta, log_sizes, drawn)

    def damped(direction: Any) -> Any:
        row = torch.from_numpy(direction).to(theta.dtype)
        return (product(row) + config.cg_damping * row).numpy()

    right = gradient.numpy()
    operator = LinearOperator((len(right), len(right)), matvec=damped, dtype=right.dtype)
    found, _ = cg(operator, right, rtol=1e-10, maxiter=config.cg_iterations)
    steepness = float(found @ damped(found))
    if not steepness > 0:
        return TrustRegionStep(theta, 0.0, 0.0)
    longest = math.sqrt(2 * config.max_kl / steepness) * torch.from_numpy(found).to(theta.dtype)
    before, _ = objective.judge(theta, log_sizes, drawn)
    for attempt in range(config.backtracks):
        length = config.backtrack_ratio**attempt
        moved = theta + length * longest
        worth, kl = objective.judge(moved, log_sizes, drawn)
        if worth > before and kl <= config.max_kl:
            return TrustRegionStep(moved, kl, length)
    return TrustRegionStep(theta, 0.0, 0.0)
