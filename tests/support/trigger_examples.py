"""Readings, streams and models for the tests of the trigger."""

from __future__ import annotations

import math

import numpy as np

from merap.mdp.model import Floats
from merap.trigger.readings import Readings
from merap.trigger.trigger import Alarm, Reading, Trigger


def reading(
    reward: float = 0.0,
    expected_reward: float = 0.0,
    *,
    ratio: float = 1.0,
    gain: float = 0.0,
    policy_value: float = 10.0,
) -> Reading:
    """Return a step at one place whose successor is `ratio` times as likely under each watched change."""
    return Reading(
        reward=reward,
        expected_reward=expected_reward,
        log_likelihood=math.log(0.5),
        log_alternatives=(math.log(0.5) + math.log(ratio),) * 2,
        place=0,
        log_local=(math.log(0.5) + math.log(ratio),) * 2,
        gain=gain,
        gain_variance=0.01,
        policy_value=policy_value,
    )


def take_in(trigger: Trigger, one: Reading, *, last: bool) -> Alarm | None:
    """Take in a step, and the end of the episode if it is the last one; return an alarm of either."""
    alarm = trigger.observe(one)
    over = trigger.episode_over() if last else None
    return alarm or over


def alarms(trigger: Trigger, readings: Readings) -> list[int]:
    """Return the steps with an alarm, the trigger left to go on."""
    return [
        step
        for step in range(len(readings))
        if take_in(trigger, readings[step], last=bool(readings.last[step])) is not None
    ]


def random_readings(generator: np.random.Generator, length: int, *, level: float, drift: float) -> Readings:
    """Return a stream without a model behind it: evidence, gains and ends of episodes at random."""
    return Readings(
        reward=generator.normal(drift, 1.0, length),
        expected_reward=np.zeros(length),
        log_likelihood=np.log(generator.uniform(0.05, 1.0, length)),
        log_alternatives=_log_uniform(generator, length) + level,
        place=generator.integers(-1, 5, length),
        log_local=_log_uniform(generator, length) + level,
        gain=generator.normal(drift, 0.3, length),
        gain_variance=np.full(length, 0.09),
        policy_value=3.0,
        last=generator.random(length) < 0.15,
    )


def _log_uniform(generator: np.random.Generator, length: int) -> Floats:
    drawn: Floats = np.log(generator.uniform(0.05, 1.0, (length, 2)))
    return drawn
