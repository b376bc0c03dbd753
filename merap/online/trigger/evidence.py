"""Evidence of a change in single steps: likelihood ratios whose mean is at most 1 while the model holds.

Of transitions: watched changes against the model. Of rewards: a mean that is lower by so many standard
deviations of the noise, in every step or in some of them. With Gaussian noise, or lighter tails of that
standard deviation, each is an e-value (Shin, Ramdas and Rinaldo 2024, "E-detectors", section 2).

Axes: M steps, K components (kinds of change).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from merap.mdp.model import Floats


@dataclass(frozen=True)
class RewardDrop:
    """A change of rewards that is watched for.

    Attributes:
        deviations: by how many standard deviations of the noise the mean is lower.
        share: part of the steps in which it is.
    """

    deviations: float
    share: float


# A small loss in every step; a large one in some, as where a goal no longer pays.
REWARD_DROPS = (RewardDrop(0.5, 1.0), RewardDrop(4.0, 0.1))


def log_evidence(
    log_likelihood: Floats, log_alternatives: Floats, residual: Floats, max_evidence: float
) -> Floats:
    """What each step says for each kind of change.

    Args:
        log_likelihood: float64 [M], of the successors, under the model.
        log_alternatives: float64 [M, W], under each of the W watched changes.
        residual: float64 [M], reward less what was expected, in standard deviations of the noise.
        max_evidence: cut to that; the mean of a ratio only falls by it.

    Returns:
        float64 [M, K], logarithms of the likelihood ratios; transitions first, K = W + the reward drops.
    """
    of_transitions = log_alternatives - log_likelihood[:, np.newaxis]
    of_rewards = np.stack([_of_drop(drop, residual) for drop in REWARD_DROPS], axis=1)
    evidence: Floats = np.minimum(np.concatenate([of_transitions, of_rewards], axis=1), max_evidence)
    return evidence


def _of_drop(drop: RewardDrop, residual: Floats) -> Floats:
    ratio = -drop.deviations * residual - drop.deviations**2 / 2
    if drop.share == 1:
        return ratio
    mixed: Floats = np.logaddexp(math.log1p(-drop.share), math.log(drop.share) + ratio)
    return mixed
