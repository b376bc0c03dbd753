"""Evidence of a change in single steps: likelihood ratios whose mean is at most 1 while the model holds.

Of transitions: watched changes against the model, everywhere or at one place (`local`). Of rewards, by what
is stated of their noise:

- Gaussian, or of lighter tails: a mean that is lower by so many standard deviations, in every step or in
  some of them. Each ratio is an e-value (Shin, Ramdas and Rinaldo 2024, "E-detectors", section 2).
- Symmetric, of any size and tails: exp(-l z - l^2 z^2 / 2), whose mean over any symmetric z is at most 1,
  as cosh(l z) <= exp(l^2 z^2 / 2) (de la Pena 1999). No step gives more than half a nat.

Axes: M steps, K components (kinds of change).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from merap.mdp.model import Floats
from merap.trigger.settings import ChangeSettings


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
GAUSSIAN = (RewardDrop(0.5, 1.0), RewardDrop(4.0, 0.1))
# One over the losses, in standard deviations, that are told best.
SYMMETRIC = (0.05, 0.3, 1.5)


def num_kinds(settings: ChangeSettings) -> int:
    """K, transitions first."""
    return len(settings.odds) + 1 + len(GAUSSIAN if settings.tails == "gaussian" else SYMMETRIC)


def log_evidence(
    log_likelihood: Floats,
    log_alternatives: Floats,
    local: Floats,
    residual: Floats,
    settings: ChangeSettings,
) -> Floats:
    """What each step says for each kind of change.

    Args:
        log_likelihood: float64 [M], of the successors, under the model.
        log_alternatives: float64 [M, W], under each of the W changes watched for everywhere.
        local: float64 [M], logarithms of the ratios for changes at one place.
        residual: float64 [M], reward less what was expected.
        settings: noise, its tails, and what a step can say at most; the mean of a ratio only falls by that.

    Returns:
        float64 [M, K], logarithms of the likelihood ratios; transitions first.
    """
    of_transitions = log_alternatives - log_likelihood[:, np.newaxis]
    deviations = residual / settings.noise
    if settings.tails == "gaussian":
        of_rewards = np.stack([_of_drop(drop, deviations) for drop in GAUSSIAN], axis=1)
    else:
        tilted = deviations[:, np.newaxis] * np.array(SYMMETRIC)
        of_rewards = -tilted - tilted**2 / 2
    every = np.concatenate([of_transitions, local[:, np.newaxis], of_rewards], axis=1)
    evidence: Floats = np.minimum(every, settings.max_evidence)
    return evidence


def _of_drop(drop: RewardDrop, residual: Floats) -> Floats:
    ratio = -drop.deviations * residual - drop.deviations**2 / 2
    if drop.share == 1:
        return ratio
    mixed: Floats = np.logaddexp(math.log1p(-drop.share), math.log(drop.share) + ratio)
    return mixed
