"""The triggers on whole streams of readings at once: what `python -m scripts.bench trigger` measures.

A second route to what `change.ChangeTrigger` and `window.WindowTrigger` do step by step: cumulated sums
instead of recursions. Every step was seen, and the last one of an episode is marked in place of
`Trigger.episode_over`. Cool-down and budget belong to a loop and are left out.

Axes: M steps of a stream, K kinds of change, H ways in which one place may change, J ends of episodes or
windows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from merap.mdp.assembly import sum_by
from merap.mdp.model import Bools, Floats, Ints
from merap.trigger.change import SHIFTED
from merap.trigger.evidence import log_evidence
from merap.trigger.readings import Readings
from merap.trigger.settings import ChangeSettings, WindowSettings

# Steps that are looked at first for an alarm; without one, four times as many.
CHUNK = 512


@dataclass(frozen=True, eq=False)
class Trace:
    """What a `ChangeTrigger` computes before it compares with thresholds.

    Attributes:
        evidence: float64 [M], logarithm of the e-detector.
        ends: int64 [J], the steps that end an episode.
        deviations: float64 [J], of the loss there, see `change.ChangeCost`.
    """

    evidence: Floats
    ends: Ints
    deviations: Floats


def trace(settings: ChangeSettings, readings: Readings) -> Trace:
    """Compute the evidence of a stream, from its beginning."""
    log_ratios = readings.log_local - readings.log_likelihood[:, np.newaxis]
    steps = log_evidence(
        readings.log_likelihood,
        readings.log_alternatives,
        local_evidence(readings.place, log_ratios, settings.local),
        readings.reward - readings.expected_reward,
        settings,
    )
    sums = _cumulated(steps)  # [M + 1, K]
    detectors = sums[1:] + np.logaddexp.accumulate(-sums[:-1], axis=0)
    least = np.minimum.accumulate(sums[:-1], axis=0)
    ends = np.flatnonzero(_ended(readings.last, settings.longest))
    leader = np.argmax((sums[1:] - least)[ends], axis=1)
    start = _last_zeros(sums)[ends, leader]
    return Trace(
        evidence=np.logaddexp.reduce(detectors, axis=1) - math.log(steps.shape[1]),
        ends=ends,
        deviations=_deviations(settings, readings, start, ends),
    )


def local_evidence(place: Ints, log_ratios: Floats, chance: float) -> Floats:
    """Return float64 [M], logarithms of the likelihood ratios of `local.LocalOdds`.

    Args:
        place: int64 [M].
        log_ratios: float64 [M, H].
        chance: of a change at each visit.
    """
    order = np.argsort(place, kind="stable")
    begins = np.flatnonzero(np.diff(place[order])) + 1
    found = np.zeros(len(place))
    for visits in np.split(order, begins):
        sums = _cumulated(log_ratios[visits] - math.log1p(-chance))
        coming = math.log(chance / log_ratios.shape[1])
        log_odds = sums[1:] + np.logaddexp.accumulate(coming - sums[:-1], axis=0)
        with_none = np.logaddexp(0.0, np.logaddexp.reduce(log_odds, axis=1))
        found[visits] = math.log1p(-chance) + np.diff(with_none, prepend=0.0)
    return found


def first_alarm(traced: Trace, settings: ChangeSettings, log_threshold: float | None = None) -> int | None:
    """Return the step (from 0) of the first alarm; None: there is none.

    Args:
        traced: a stream.
        settings: of the detector.
        log_threshold: of the evidence; None: that of the settings.
    """
    threshold = math.log(settings.steps_per_false_alarm) if log_threshold is None else log_threshold
    number = np.arange(1, len(traced.evidence) + 1)
    up = np.maximum.accumulate(np.where(traced.evidence >= threshold, number, 0))
    down = np.maximum.accumulate(np.where(traced.evidence < settings.release * threshold, number, 0))
    suspicious = (up > down)[traced.ends]
    alarms = traced.ends[suspicious & (traced.deviations >= settings.deviations)]
    return int(alarms[0]) if len(alarms) else None


def count_alarms(settings: ChangeSettings, readings: Readings, log_threshold: float | None = None) -> int:
    """Count the alarms of a stream if the detector begins anew after each of them."""
    count, begin, length = 0, 0, CHUNK
    while begin < len(readings):
        traced = trace(settings, readings.part(slice(begin, begin + length)))
        alarm = first_alarm(traced, settings, log_threshold)
        if alarm is not None:
            count, begin, length = count + 1, begin + alarm + 1, CHUNK
        elif begin + length >= len(readings):
            break
        else:
            length *= 4
    return count


def window_rewards(settings: WindowSettings, readings: Readings) -> tuple[Ints, Floats]:
    """Return int64 [J], the ends of windows, and float64 [J], their discounted rewards.

    A `WindowTrigger` gives an alarm at the first that is below its threshold.
    """
    reward, length = readings.reward, len(readings)
    if settings.steps is None:
        window: Ints = np.cumsum(readings.last) - readings.last
        start = np.concatenate([[0], np.flatnonzero(readings.last) + 1])
        weighted = reward * settings.per_step ** (np.arange(length) - start[window])
        ends = np.flatnonzero(readings.last)
        return ends, sum_by(window, weighted, len(ends))[: len(ends)]
    weights = settings.per_step ** np.arange(settings.steps)
    if length < settings.steps:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    every = 1 if settings.sliding else settings.steps
    rewards = np.lib.stride_tricks.sliding_window_view(reward, settings.steps)[::every] @ weights
    return np.arange(len(rewards)) * every + settings.steps - 1, rewards


def _cumulated(values: Floats) -> Floats:
    """Return [M + 1, ...], sums of the first 0, 1, .. M entries."""
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])


def _ended(last: Bools, longest: int) -> Bools:
    """Return bool [M], where an episode ends or has lasted too long."""
    number = np.arange(len(last))
    begun = np.maximum.accumulate(np.where(np.concatenate([[True], last[:-1]]), number, 0))
    ended: Bools = last | ((number - begun) % longest == longest - 1)
    return ended


def _last_zeros(sums: Floats) -> Ints:
    """Return int64 [M, K], the number of steps before the likeliest change, seen from each step."""
    lowest = np.minimum.accumulate(sums, axis=0)
    zero = np.concatenate([np.ones((1, sums.shape[1]), dtype=np.bool_), sums[1:] <= lowest[:-1]])
    number = np.arange(len(sums))[:, np.newaxis]
    return np.maximum.accumulate(np.where(zero, number, 0), axis=0)[:-1]


def _deviations(settings: ChangeSettings, readings: Readings, start: Ints, ends: Ints) -> Floats:
    """Return float64 [J], of the loss between the starts and the ends; see `change.estimated_loss`."""

    def part(values: Floats) -> Floats:
        total = _cumulated(values)
        return total[ends + 1] - total[start]

    ended = np.zeros(len(readings))
    ended[ends] = 1.0
    residual = part(readings.reward - readings.expected_reward)
    noise = settings.noise**2 * (ends + 1 - start)
    shifted = np.abs(residual) > SHIFTED * np.sqrt(noise)
    loss = -part(readings.gain) - np.where(shifted, residual, 0.0)
    variance = part(readings.gain_variance) + np.where(shifted, noise, 0.0)
    excess = loss - settings.tolerated_loss * abs(readings.policy_value) * part(ended)
    certain = np.where(excess > 0, np.inf, -np.inf)
    # differences of cumulated sums can be a rounding error below 0
    spread = np.sqrt(np.maximum(variance, 0.0))
    return np.divide(excess, spread, out=certain, where=spread > 0)
