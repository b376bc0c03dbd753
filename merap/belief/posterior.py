"""A joint posterior over what the real domain may be (the analyzer's knowledge of it).

Transitions speak of environment, capability and slip, rewards and ends of the objective.
The posterior is a product of the two as long as the likelihood of every observation is; an
observation that couples them (the task ended, and where it ended is not seen) is kept exactly
in a third term while that has at most `MAX_COUPLED` entries, and shared out to the two above.

Axes as in `space`; E is the number of environments still in play.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.belief.space import HypothesisSpace
from merap.mdp.model import Bools, Floats, Ints

MAX_COUPLED = 4_000_000
# Environments whose posterior odds against the best are beyond e^-60 are dropped.
NEGLIGIBLE_LOG = -60.0


@dataclass(frozen=True, eq=False)
class Belief:
    """Log-weights, normalised, and the evidence on unknown closed locations.

    Attributes:
        environments: int64 [E], those in play.
        dynamics: float64 [E, C, W], log.
        objective: float64 [O, Y], log, with the noise on rewards.
        coupled: float64 [E, C, W, O, Y], log, in place of both; None: they are independent.
        closed: float64 [U, V, W, P], log-likelihood ratio of closed to open, by moves.
        obstacle: float64 [P], log-likelihood ratio of obstacle to none, by detectors.
        learned: nats by which all observations have changed the belief.
        evidence: log-probability of all that was observed under the prior (rewards: density). Factors that
            are the same whatever is believed are left out, so only differences mean something, between
            beliefs that have seen the same.
        unexplained: how many observations no hypothesis allows; they are left out.
    """

    environments: Ints
    dynamics: Floats
    objective: Floats
    coupled: Floats | None
    closed: Floats
    obstacle: Floats
    learned: float = 0.0
    evidence: float = 0.0
    unexplained: int = 0


def prior_belief(space: HypothesisSpace) -> Belief:
    """Before anything is observed."""
    classes = (len(space.attributes), int(space.capability_class.max()) + 1, len(space.slips))
    return Belief(
        environments=np.arange(len(space.environment_names)),
        dynamics=space.prior,
        objective=space.objective_prior[:, np.newaxis] + np.log(space.noise_prior),
        coupled=None,
        closed=np.zeros((*classes, space.space.num_locations)),
        obstacle=np.zeros(space.space.num_locations),
    )


def weights(belief: Belief) -> tuple[Floats, Floats]:
    """The marginals: float64 [E, C, W] of the dynamics and [O, Y] of the objective."""
    if belief.coupled is None:
        return _softmax(belief.dynamics), _softmax(belief.objective)
    joint = _softmax(belief.coupled)
    return joint.sum(axis=(3, 4)), joint.sum(axis=(0, 1, 2))


def _softmax(log: Floats) -> Floats:
    unnormalised = np.exp(log - log.max())
    shares: Floats = unnormalised / unnormalised.sum()
    return shares


def concern_weights(space: HypothesisSpace, belief: Belief) -> tuple[Floats, Floats, Floats]:
    """The marginals of each concern.

    Returns:
        float64 [all environments], [C] and [O].
    """
    dynamics, objective = weights(belief)
    environment = np.zeros(len(space.environment_names))
    environment[belief.environments] = dynamics.sum(axis=(1, 2))
    return environment, dynamics.sum(axis=(0, 2)), objective.sum(axis=1)


def reweighted(belief: Belief, dynamics: Floats | None, objective: Floats | None) -> Belief:
    """Bayes' rule with a likelihood that is a product.

    Args:
        belief: the prior.
        dynamics: float64 [E, C, W], log-likelihood; None: it says nothing.
        objective: float64 [O, Y], log-likelihood; None: it says nothing.

    Returns:
        The posterior; the prior with one more unexplained observation if all of it is 0.
    """
    if belief.coupled is not None:
        told = np.zeros_like(belief.dynamics) if dynamics is None else dynamics
        of_objective = np.zeros_like(belief.objective) if objective is None else objective
        return coupled_by(belief, told[..., np.newaxis, np.newaxis] + of_objective)
    by_dynamics = _bayes(belief.dynamics, dynamics)
    by_objective = _bayes(belief.objective, objective)
    if by_dynamics is None or by_objective is None:
        return replace(belief, unexplained=belief.unexplained + 1)
    updated = replace(
        belief,
        dynamics=by_dynamics.posterior,
        objective=by_objective.posterior,
        learned=belief.learned + by_dynamics.news + by_objective.news,
        evidence=belief.evidence + by_dynamics.evidence + by_objective.evidence,
    )
    return updated if dynamics is None else _in_play(updated)


@dataclass(frozen=True, eq=False)
class _Updated:
    """By Bayes' rule, all logs.

    Attributes:
        posterior: normalised.
        news: its divergence from the prior, in nats.
        evidence: probability of the observation under the prior.
    """

    posterior: Floats
    news: float = 0.0
    evidence: float = 0.0


def _bayes(prior: Floats, likelihood: Floats | None) -> _Updated | None:
    """From a normalised prior, by a likelihood, both logs; None if all is 0."""
    if likelihood is None:
        return _Updated(prior)
    posterior = prior + likelihood
    top = posterior.max()
    if top == -np.inf:
        return None
    share = np.exp(posterior - top)
    total = float(share.sum())
    evidence = float(top) + float(np.log(total))
    kept = share > 0
    news = float(share[kept] @ likelihood[kept]) / total - evidence
    return _Updated(posterior - evidence, max(news, 0.0), evidence)


def coupled_by(belief: Belief, likelihood: Floats) -> Belief:
    """Bayes' rule with a likelihood that is no product.

    Args:
        belief: the prior.
        likelihood: float64 [E, C, W, O, Y], log.
    """
    prior = belief.dynamics[..., np.newaxis, np.newaxis] + belief.objective
    if belief.coupled is not None:
        prior = prior + belief.coupled
    found = _bayes(prior, likelihood)
    if found is None:
        return replace(belief, unexplained=belief.unexplained + 1)
    return replace(
        belief,
        dynamics=np.zeros_like(belief.dynamics),
        objective=np.zeros_like(belief.objective),
        coupled=found.posterior,
        learned=belief.learned + found.news,
        evidence=belief.evidence + found.evidence,
    )


def _in_play(belief: Belief) -> Belief:
    """Without the environments that are refuted."""
    best = belief.dynamics.max(axis=(1, 2))
    keep = best > best.max() + NEGLIGIBLE_LOG
    if keep.sum() > 0.7 * len(keep):
        return belief
    return replace(belief, environments=belief.environments[keep], dynamics=belief.dynamics[keep])


def open_moves(space: HypothesisSpace, belief: Belief, location: int, moves: tuple[int, ...]) -> Bools:
    """bool [E, C, k]: the moves that what is known of a hypothesis leaves open at a location."""
    rows = belief.environments
    targets = space.space.target[location, list(moves)]
    exists = targets >= 0
    closed = space.blocked[rows][:, np.newaxis, targets] | space.no_entry[np.newaxis, :, targets]
    if space.blocked_edges is not None:
        closed = closed | space.blocked_edges[rows][:, np.newaxis, location, list(moves)]
    free: Bools = exists & ~closed
    return free
