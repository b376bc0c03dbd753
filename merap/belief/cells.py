"""Locations that are closed in a way no configuration says: a factored posterior, location by location.

Under an unknown environment each location holds an obstacle with a small probability; under an
unknown capability each is one the system can't enter. A move that fails is evidence for both; a detector of
obstacles tells them apart. As long as an action has one move, a step speaks of one location, and the
product of locations is the exact posterior.

Axes: F families, U, V, W, P as in `space`.
"""

from __future__ import annotations

import numpy as np

from merap.mdp.model import Floats

# Families of hypotheses by what is unknown: nothing, obstacles, no entry, both.
KNOWN, OBSTACLES, NO_ENTRY, BOTH = range(4)


def closed_probability(evidence: Floats, obstacle_evidence: Floats, prior: float) -> Floats:
    """That a location is closed in an unknown way.

    Args:
        evidence: float64 [..., P], log-likelihood ratio of closed to open, by moves.
        obstacle_evidence: float64 [P], log-likelihood ratio of obstacle to none, by detectors.
        prior: of each kind.

    Returns:
        float64 [F, ..., P]; 0 in the family KNOWN.
    """
    odds = np.log(prior) - np.log1p(-prior)
    either = odds + np.logaddexp(obstacle_evidence, 0.0)
    logits = (evidence + odds + obstacle_evidence, evidence + odds, evidence + either)
    return np.stack([np.zeros_like(evidence), *(_logistic(logit) for logit in logits)])


def obstacle_probability(evidence: Floats, obstacle_evidence: Floats, prior: float) -> Floats:
    """That a location holds an unknown obstacle; arguments and result as in `closed_probability`."""
    closed = closed_probability(evidence, obstacle_evidence, prior)
    closed[NO_ENTRY] = 0.0
    closed[BOTH] *= _logistic(obstacle_evidence)
    return closed


def _logistic(logit: Floats) -> Floats:
    # Written with tanh, which does not overflow.
    share: Floats = 0.5 * (1 + np.tanh(0.5 * logit))
    return share


def added(evidence: Floats, closed: Floats, is_open: Floats) -> Floats:
    """Evidence after an observation.

    Args:
        evidence: float64 [...], log-likelihood ratio of closed to open.
        closed: float64 [...], the observation's likelihood if the location is closed.
        is_open: float64 [...], if it is open. Where both are 0 nothing is added: the
            hypothesis is refuted, whatever the location.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(closed) - np.log(is_open)
        total = evidence + ratio
    told = (closed > 0) | (is_open > 0)
    # Certainty against certainty: the later observation holds.
    return np.where(told, np.where(np.isnan(total), ratio, total), evidence)


def with_unknown(table: Floats, closed: Floats) -> Floats:
    """Averages a table over the moves that are closed in an unknown way.

    Args:
        table: float64 [U, V, W, R, ...], by pattern of open moves.
        closed: float64 [F, U, V, W, k], probability that a move's target is closed.

    Returns:
        float64 [F, U, V, W, R, ...]: the entry of pattern r averages over the patterns that
        are open where r is and no unknown closes the move.
    """
    averaged = np.repeat(table[np.newaxis], len(closed), axis=0)
    patterns = np.arange(table.shape[3])
    for bit in range(closed.shape[-1]):
        is_open = patterns[(patterns >> bit) & 1 == 1]
        shut = closed[..., bit].reshape(*closed.shape[:-1], *[1] * (table.ndim - 3))
        averaged[:, :, :, :, is_open] = (1 - shut) * averaged[:, :, :, :, is_open] + shut * averaged[
            :, :, :, :, is_open ^ (1 << bit)
        ]
    return averaged
