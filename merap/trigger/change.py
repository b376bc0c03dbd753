"""A change detector that re-plans only for a change that costs value.

Two questions, both asked of the readings since the likeliest moment of a change:

1. *Does the model no longer hold?* A Shiryaev-Roberts e-detector, R_n = L_n (1 + R_{n-1}), for each watched
   change, and their mean. With likelihood ratios whose mean is at most 1 while the model holds, R_n - n is a
   supermartingale: within n steps it passes c with a probability of at most n / c, and takes c steps or more
   on average (Shin, Ramdas and Rinaldo 2024, "E-detectors", theorem 2.4). c is `steps_per_false_alarm`.
   An alarm begins it anew. With N_n the number of times it has passed c, and R taken as 0 from there to the
   alarm, R_n + c N_n - n is a supermartingale too: in n steps at most n / c alarms are expected. Two or more
   have a probability of at most (n / c)^2 / 2, the mean of (n - t) / c over the time t of the first.
2. *Is the policy worth less for it?* The sum of gains and of rewards less what was expected is, over an
   episode, an unbiased estimate of the policy's value on the real system less its value under the model. It
   is asked when an episode ends, as what is lost in one step may be won back in a later one.

What the policy does not visit gives no readings, and what costs nothing no loss.

Axes: K kinds of change.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from merap.mdp.model import Floats
from merap.trigger.evidence import log_evidence, num_kinds
from merap.trigger.local import LocalOdds
from merap.trigger.settings import ChangeSettings
from merap.trigger.trigger import Alarm, Reading

# Below that many standard deviations a shift of the rewards is taken for noise.
SHIFTED = 2.0


@dataclass(frozen=True)
class Totals:
    """Sums over the readings so far.

    Attributes:
        steps: how many.
        episodes: that are over.
        gain: of the transitions.
        gain_variance: of that sum, while the model holds.
        residual: rewards less what was expected.
    """

    steps: int = 0
    episodes: int = 0
    gain: float = 0.0
    gain_variance: float = 0.0
    residual: float = 0.0

    def since(self, start: Totals) -> Totals:
        """The part that came after `start`."""
        return Totals(
            self.steps - start.steps,
            self.episodes - start.episodes,
            self.gain - start.gain,
            self.gain_variance - start.gain_variance,
            self.residual - start.residual,
        )


@dataclass(frozen=True)
class ChangeCost:
    """What a change costs.

    Attributes:
        per_episode: estimated.
        deviations: by how many standard deviations it exceeds what is tolerated.
    """

    per_episode: float
    deviations: float


def estimated_loss(part: Totals, policy_value: float, settings: ChangeSettings) -> ChangeCost:
    """The loss over the episodes of `part`, of which there is at least one.

    Rewards count only if they are off by more than their noise explains; else they would hide a loss
    that the transitions show clearly.
    """
    noise = part.steps * settings.noise**2
    shifted = abs(part.residual) > SHIFTED * math.sqrt(noise)
    loss = -part.gain - (part.residual if shifted else 0.0)
    # a difference of sums can be a rounding error below 0
    variance = max(part.gain_variance, 0.0) + (noise if shifted else 0.0)
    excess = loss - settings.tolerated_loss * abs(policy_value) * part.episodes
    # Without any variance under the model a single loss is certain.
    certain = math.inf if excess > 0 else -math.inf
    deviations = excess / math.sqrt(variance) if variance > 0 else certain
    return ChangeCost(loss / part.episodes, deviations)


class ChangeTrigger:
    """Detects a change that costs value, with hysteresis, cool-down and a budget of re-plannings.

    A suspicion begins when the evidence passes the threshold and lasts until it falls well below; only
    under suspicion losses are judged. A missed step is neither evidence nor loss, and an episode of which
    no step was seen counts as none.

    Args:
        settings: of the detector.
    """

    def __init__(self, settings: ChangeSettings) -> None:
        self._settings = settings
        self._threshold = math.log(settings.steps_per_false_alarm)
        self._kinds = num_kinds(settings)
        self._clock = 0
        self._used: deque[int] = deque()
        self._cooldown = 0
        self._begin()

    @property
    def evidence(self) -> float:
        """Logarithm of the e-detector."""
        return float(np.logaddexp.reduce(self._detectors)) - math.log(self._kinds)

    @property
    def suspicious(self) -> bool:
        """Whether the model is held to be wrong, be it at a cost or not."""
        return self._suspicious

    def observe(self, reading: Reading) -> Alarm | None:
        """Take in a step; an alarm when an episode that a change has made worse lasts too long."""
        self._clock += 1
        self._policy_value = reading.policy_value
        self._add_evidence(reading)
        self._add_to_totals(reading)
        if self.evidence >= self._threshold:
            self._suspicious = True
        elif self.evidence < self._settings.release * self._threshold:
            self._suspicious = False
        return self._ended() if self._since_end >= self._settings.longest else None

    def missed(self) -> None:
        """Nothing is known of it, so nothing is concluded."""

    def episode_over(self) -> Alarm | None:
        """An alarm if a change has made the episode worse."""
        return self._ended() if self._since_end > 0 else None

    def replanned(self) -> None:
        """Forget what was held against the old model; the cool-down begins and the budget shrinks."""
        self._used.append(self._clock)
        self._cooldown = self._settings.cooldown
        self._begin()

    def _begin(self) -> None:
        self._detectors: Floats = np.full(self._kinds, -np.inf)
        self._sums: Floats = np.zeros(self._kinds)
        self._local = LocalOdds(self._settings.local)
        self._totals = Totals()
        self._starts = [self._totals] * self._kinds
        self._since_end = 0
        self._policy_value = 0.0
        self._suspicious = False

    def _ended(self) -> Alarm | None:
        """An episode has ended, or has lasted so long that it is judged."""
        self._since_end = 0
        self._totals = replace(self._totals, episodes=self._totals.episodes + 1)
        ready = self._cooldown == 0 and self._within_budget()
        self._cooldown = max(self._cooldown - 1, 0)
        return self._judge(self._policy_value) if ready and self._suspicious else None

    def _within_budget(self) -> bool:
        while self._used and self._used[0] <= self._clock - self._settings.budget_steps:
            self._used.popleft()
        return len(self._used) < self._settings.budget

    def _add_evidence(self, reading: Reading) -> None:
        """One step of each e-detector, and of each CUSUM, whose last zero is the likeliest change."""
        local = self._local.observe(reading.place, np.array(reading.log_local) - reading.log_likelihood)
        (evidence,) = log_evidence(
            np.array([reading.log_likelihood]),
            np.array([reading.log_alternatives]),
            np.array([local]),
            np.array([reading.reward - reading.expected_reward]),
            self._settings,
        )
        self._detectors = evidence + np.logaddexp(0.0, self._detectors)
        for kind in np.flatnonzero(self._sums <= 0):
            self._starts[kind] = self._totals
        self._sums = np.maximum(self._sums, 0.0) + evidence

    def _add_to_totals(self, reading: Reading) -> None:
        self._since_end += 1
        totals = self._totals
        self._totals = replace(
            totals,
            steps=totals.steps + 1,
            gain=totals.gain + reading.gain,
            gain_variance=totals.gain_variance + reading.gain_variance,
            residual=totals.residual + reading.reward - reading.expected_reward,
        )

    def _judge(self, policy_value: float) -> Alarm | None:
        part = self._totals.since(self._starts[int(np.argmax(self._sums))])
        loss = estimated_loss(part, policy_value, self._settings)
        if loss.deviations < self._settings.deviations:
            return None
        reason = (
            f"the model has not held for the last {part.steps} steps (evidence e^{self.evidence:.1f}, "
            f"threshold e^{self._threshold:.1f}), and an episode earns {loss.per_episode:.3g} less than the "
            f"{policy_value:.3g} expected"
        )
        return Alarm("change", self.evidence, self._threshold, reason)
