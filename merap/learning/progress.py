"""What updates have shown, and whether training still gets somewhere: plateaus, collapses, the best policy.

Judged by the adapted return, averaged over the last updates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

# Updates whose mean is compared: enough to smooth the draw of tasks and episodes.
WINDOW = 10
# A fall counts as a collapse from that part of all the ground ever covered.
COLLAPSE = 0.2
# And from that many standard errors of the difference of both windows' means: the best of many means of
# noise lies some 3 above the true one, the last may lie as many below.
CERTAIN = 6.0


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


class Progress:
    """What the adapted returns of a run so far amount to.

    Args:
        history: the returns of updates 1, 2, ...
        least_gain: what counts as a gain, in units of the ground covered.

    Attributes:
        best_update: the end of the best window; 0 before the first is full.
        best_score: its mean; nan likewise.
    """

    def __init__(self, history: Sequence[float] = (), least_gain: float = 0.0) -> None:
        self.best_update = 0
        self.best_score = math.nan
        self._best_variance = math.nan
        self._least_gain = least_gain
        self._last: list[float] = []
        self._updates = 0
        self._lowest, self._highest = math.inf, -math.inf
        for adapted_return in history:
            self.observe(adapted_return)

    def observe(self, adapted_return: float) -> bool:
        """Take in one more return; whether the window that it ends is the best so far."""
        self._updates += 1
        self._last = [*self._last[-WINDOW + 1 :], adapted_return]
        if len(self._last) < WINDOW:
            return False
        score = self.score
        self._lowest, self._highest = min(self._lowest, score), max(self._highest, score)
        gain = self._least_gain * self._ground
        if self.best_update and not score > self.best_score + gain:
            return False
        self.best_update, self.best_score = self._updates, score
        self._best_variance = _variance(self._last)
        return True

    @property
    def score(self) -> float:
        """Mean of the last window, as far as it is full; nan before the first update."""
        return math.fsum(self._last) / len(self._last) if self._last else math.nan

    @property
    def since_best(self) -> int:
        """Updates since the best window."""
        return self._updates - self.best_update

    @property
    def collapsed(self) -> bool:
        """Whether the last window has fallen clearly below the best one."""
        if not self.best_update:
            return False
        error = math.sqrt((_variance(self._last) + self._best_variance) / WINDOW)
        return self.best_score - self.score > max(COLLAPSE * self._ground, CERTAIN * error)

    @property
    def _ground(self) -> float:
        """How far the mean of a window has ever moved."""
        return self._highest - self._lowest


def _variance(returns: Sequence[float]) -> float:
    mean = math.fsum(returns) / len(returns)
    return math.fsum((one - mean) ** 2 for one in returns) / len(returns)
