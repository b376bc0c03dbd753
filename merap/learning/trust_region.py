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

from scipy.sparse.linalg import LinearOperator, cg

from merap.learning.config import TrainingConfig
from merap.learning.core.jit import Array
from merap.learning.core.meta import Drawn
from merap.learning.meta import Objective


@dataclass(frozen=True, eq=False)
class TrustRegionStep:
    """Where a step led to.

    Attributes:
        theta: float [P], after it; the same as before if no length was accepted.
        kl: mean divergence of the adapted policies, in nats.
        length: part of the longest step that the divergence allows; 0: none was accepted.
    """

    theta: Array
    kl: float
    length: float


def trust_region_step(
    objective: Objective, theta: Array, gradient: Array, drawn: Sequence[Drawn], config: TrainingConfig
) -> TrustRegionStep:
    """One step from a gradient of the objective, with what was drawn for it.

    Args:
        objective: what is to be improved.
        theta: float [P].
        gradient: float [P], of the objective in theta.
        drawn: what it was made from.
        config: the bound on the divergence, and how it is searched.
    """
    part, known, entries = objective.on_counting_states(drawn)
    found = _step(part, theta[entries], gradient[entries], known, config)
    moved = theta.copy()
    moved[entries] = found.theta
    return TrustRegionStep(moved, found.kl, found.length)


def _step(
    objective: Objective, theta: Array, gradient: Array, drawn: Sequence[Drawn], config: TrainingConfig
) -> TrustRegionStep:
    product = objective.curvature(theta, drawn)

    def damped(direction: Array) -> Array:
        row = direction.astype(theta.dtype)
        return product(row) + theta.dtype.type(config.cg_damping) * row

    operator = LinearOperator((len(theta), len(theta)), matvec=damped, dtype=theta.dtype)
    found, _ = cg(operator, gradient, rtol=1e-10, maxiter=config.cg_iterations)
    steepness = float(found @ damped(found))
    if not steepness > 0:
        return TrustRegionStep(theta, 0.0, 0.0)
    longest = (math.sqrt(2 * config.max_kl / steepness) * found).astype(theta.dtype)
    before, _ = objective.judge(theta, drawn)
    for attempt in range(config.backtracks):
        length = config.backtrack_ratio**attempt
        moved = theta + theta.dtype.type(length) * longest
        worth, kl = objective.judge(moved, drawn)
        if worth > before and kl <= config.max_kl:
            return TrustRegionStep(moved, kl, length)
    return TrustRegionStep(theta, 0.0, 0.0)
