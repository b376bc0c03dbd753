"""What a trigger sees of a step, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol


@dataclass(frozen=True)
class Reading:
    """A step held against the current model; `forecast` makes it.

    Attributes:
        reward: as received, noise included.
        expected_reward: of the transition that was seen, under the model.
        log_likelihood: of the successor that was seen, under the model and its floor.
        log_alternatives: of the same successor, under each of the changes that are watched for everywhere.
        place: state and action, as a number.
        log_local: of the successor, under each of the changes that are watched for at a place alone.
        gain: r(s, a, s') + V(s') - Q(s, a), what the draw of the successor alone won or lost; its mean is 0
            as long as the model holds. V and Q are the policy's values under the model.
        gain_variance: of the gain, under the model.
        policy_value: what an episode is worth, under the model.
    """

    reward: float
    expected_reward: float
    log_likelihood: float
    log_alternatives: tuple[float, ...]
    place: int
    log_local: tuple[float, ...]
    gain: float
    gain_variance: float
    policy_value: float


@dataclass(frozen=True)
class Alarm:
    """A reason to re-plan.

    Attributes:
        kind: the paper's threshold was missed, or a change was detected.
        statistic: what was held against the threshold.
        threshold: that it passed.
        reason: one plain sentence.
    """

    kind: Literal["threshold", "change"]
    statistic: float
    threshold: float
    reason: str


class Trigger(Protocol):
    """Decides when to re-plan, step by step.

    It is told of each step, in order, that it was seen whole or that it was not, and of the end of each
    episode, seen or not.
    """

    def observe(self, reading: Reading) -> Alarm | None:
        """Take in a step; an alarm if it is time to re-plan."""

    def missed(self) -> None:
        """Take note that the coming steps are unobserved."""

    def episode_over(self) -> Alarm | None:
        """No more steps of this episode follow; an alarm if it is time to re-plan."""

    def replanned(self) -> None:
        """A new policy is carried out from now on, and readings are held against a new model."""
