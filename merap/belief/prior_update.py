"""Update of the prior: hypotheses outside the base gain the weight that they had in the end.

The new prior is a mixture of the prior and the posterior, for the dynamics and for the objective each.
It keeps that some locations were closed in an unknown way, not which ones: the prior of each is one
number. With each update the older ones count half.

Axes as in `space`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.belief.explanation import summarise
from merap.belief.posterior import Belief, weights
from merap.belief.space import HypothesisSpace

# Share of the posterior in the mixture; the rest is the prior.
SHARE = 0.5


def updated_prior(space: HypothesisSpace, belief: Belief) -> HypothesisSpace:
    """Return the hypotheses with the mixture of their prior and a belief as prior.

    Args:
        space: the hypotheses.
        belief: the posterior about the system that was managed.
    """
    dynamics, noisy = weights(belief)
    posterior = np.zeros_like(space.prior)
    posterior[belief.environments] = dynamics
    with np.errstate(divide="ignore"):  # what has no weight has a log of -inf
        return replace(
            space,
            prior=np.log((1 - SHARE) * np.exp(space.prior) + SHARE * posterior),
            objective_prior=np.log((1 - SHARE) * np.exp(space.objective_prior) + SHARE * noisy.sum(axis=1)),
        )


def base_weight(space: HypothesisSpace, belief: Belief) -> float:
    """Return the weight of the hypotheses that combine configurations of the base, outcomes undisturbed."""
    dynamics, noisy = weights(belief)
    known = belief.environments < len(space.environment_names) - 1
    num_capabilities = dynamics.shape[1] - int(space.capability_class[-1]) - 1
    objective = noisy[: space.num_objectives].sum()
    return float(dynamics[known, :num_capabilities, 0].sum() * objective)


def likeliest(space: HypothesisSpace, belief: Belief) -> tuple[str, ...]:
    """Return the names of the heaviest configurations, kind of outcomes and further closed locations."""
    found = summarise(space, belief)
    heaviest = (found.environment, found.capability, found.objective, found.outcomes)
    return (*(one[0][0] for one in heaviest), *sorted(name for name, _ in found.closed))
