"""What the updates of a training run have shown."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class UpdateMetrics:
    """What one outer update showed.

    Attributes:
        update: counted from 1.
        meta_return: mean expected discounted return of the meta policy on the batch; by the
            sampled estimator, of its episodes.
        adapted_return: that of the policies after their inner steps.
        entropy: mean entropy of the meta policy over the steps of its episodes, in nats.
        gradient_norm: of the outer gradient, before it is cut.
        learning_rate: of the meta policy; nan for trpo.
        kl: trpo: mean divergence of the adapted policies by the step, in nats; else nan.
        step_length: trpo: part of the longest step allowed, 0 if none was accepted; else nan.
        variance: of the advantages, mean over the batch.
        seconds: wall-clock time of the update.
    """

    update: int
    meta_return: float
    adapted_return: float
    entropy: float
    gradient_norm: float
    learning_rate: float
    kl: float
    step_length: float
    variance: float
    seconds: float
