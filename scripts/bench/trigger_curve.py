"""Delay against false alarms, over the thresholds of a trigger.

A false alarm of a `ChangeTrigger` begins the detector anew; windows of the paper's trigger follow each
other in any case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.mdp.model import Floats
from merap.trigger.readings import Readings
from merap.trigger.settings import ChangeSettings, WindowSettings
from scripts.bench.trigger_batch import count_alarms, window_rewards
from scripts.bench.trigger_delay import Watched, change_delays, window_delays

# The measure: false alarms in so many steps, changes seen within so many episodes.
STEPS = 100_000
SOON = 3


@dataclass(frozen=True)
class Point:
    """A trigger with one threshold.

    Attributes:
        threshold: logarithm of the evidence, or reward by which TR is below a window's mean without a change.
        false_alarms: in 10^5 steps without a change.
        delay: mean number of episodes; a change that is not seen counts as long as the streams are.
        soon: part of the streams with an alarm within three episodes after the change.
    """

    threshold: float
    false_alarms: float
    delay: float
    soon: float


def change_curve(
    settings: ChangeSettings,
    quiet: Sequence[Readings],
    costly: Sequence[Watched],
    log_thresholds: Sequence[float],
    longest: int,
) -> list[Point]:
    """Compute the curve of a `ChangeTrigger`.

    Args:
        settings: but for the threshold.
        quiet: streams without a change.
        costly: streams with one.
        log_thresholds: of the evidence.
        longest: what a delay counts at most.
    """
    points = []
    for threshold in log_thresholds:
        alarms = sum(count_alarms(settings, readings, threshold) for readings in quiet)
        delays = np.concatenate([change_delays(watched, settings, threshold) for watched in costly])
        points.append(_point(threshold, alarms, quiet, delays[~np.isnan(delays)], longest))
    return points


def window_curve(
    settings: WindowSettings,
    quiet: Sequence[Readings],
    costly: Sequence[tuple[Watched, float]],
    margins: Sequence[float],
    longest: int,
) -> list[Point]:
    """Compute the curve of a `WindowTrigger`.

    Args:
        settings: but for the threshold.
        quiet: streams without a change.
        costly: streams with one, and the mean discounted reward of a window before it.
        margins: by which TR is below the mean.
        longest: what a delay counts at most.
    """
    windows = [window_rewards(settings, readings)[1] for readings in quiet]
    points = []
    for margin in margins:
        alarms = sum(int((rewards < rewards.mean() - margin).sum()) for rewards in windows)
        delays = np.concatenate(
            [
                window_delays(watched, settings.model_copy(update={"threshold": mean - margin}))
                for watched, mean in costly
            ]
        )
        points.append(_point(margin, alarms, quiet, delays, longest))
    return points


def _point(threshold: float, alarms: int, quiet: Sequence[Readings], delays: Floats, longest: int) -> Point:
    steps = sum(map(len, quiet))
    return Point(
        threshold=threshold,
        false_alarms=alarms * STEPS / steps,
        delay=float(np.minimum(delays, longest).mean()),
        soon=float((delays <= SOON).mean()),
    )
