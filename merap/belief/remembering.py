"""A prior that remembers what was met: hypotheses outside the base gain the weight that they had in the end.

The new prior is a mixture of the prior and the posterior, for the dynamics and for the objective each.
Which locations were closed in an unknown way is not kept, only that some were: the prior of each is one
number. With each thing remembered the older ones halve.

Axes as in `space`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.belief.explanation import summarise
from merap.belief.posterior import Belief, weights
from merap.belief.space import HypothesisSpace

# Of what was met last; the rest is as before.
SHARE = 0.5


def remembered(space: HypothesisSpace, belief: Belief) -> HypothesisSpace:
    """The hypotheses with another prior.

    Args:
        space: the hypotheses.
        belief: what is believed of what was met.
    """
    dynamics, noisy = weights(belief)
    met = np.zeros_like(space.prior)
    met[belief.environments] = dynamics
    with np.errstate(divide="ignore"):  # what has no weight has a log of -inf
        return replace(
            space,
            prior=np.log((1 - SHARE) * np.exp(space.prior) + SHARE * met),
            objective_prior=np.log((1 - SHARE) * np.exp(space.objective_prior) + SHARE * noisy.sum(axis=1)),
        )


def base_weight(space: HypothesisSpace, belief: Belief) -> float:
    """The weight of the hypotheses that combine configurations of the base, with outcomes as they say."""
    dynamics, noisy = weights(belief)
    known = belief.environments < len(space.environment_names) - 1
    num_capabilities = dynamics.shape[1] - int(space.capability_class[-1]) - 1
    objective = noisy[: space.num_objectives].sum()
    return float(dynamics[known, :num_capabilities, 0].sum() * objective)


def likeliest(space: HypothesisSpace, belief: Belief) -> tuple[str, ...]:
    """The heaviest configurations and kind of outcomes, and the locations closed besides."""
    found = summarise(space, belief)
    heaviest = (found.environment, found.capability, found.objective, found.outcomes)
    return (*(one[0][0] for one in heaviest), *sorted(name for name, _ in found.closed))
