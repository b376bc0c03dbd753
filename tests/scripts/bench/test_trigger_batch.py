"""Whole streams against one step at a time."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.trigger.change import ChangeTrigger
from merap.trigger.readings import Readings
from merap.trigger.settings import ChangeSettings, WindowSettings
from merap.trigger.trigger import Trigger
from merap.trigger.window import WindowTrigger
from scripts.bench.trigger_batch import first_alarm, trace, window_rewards
from tests.support.trigger_examples import alarms, random_readings, take_in


def step_by_step(trigger: Trigger, readings: Readings) -> int | None:
    return next(iter(alarms(trigger, readings)), None)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    level=st.floats(-1.0, 0.5),
    drift=st.floats(-0.6, 0.3),
    run_length=st.floats(2.0, 1e6),
    release=st.floats(0.0, 0.95),
    deviations=st.floats(0.1, 4.0),
    longest=st.integers(1, 30),
    tails=st.sampled_from(["gaussian", "symmetric"]),
)
def test_cumulated_sums_and_recursions_agree(
    seed: int,
    level: float,
    drift: float,
    run_length: float,
    release: float,
    deviations: float,
    longest: int,
    tails: Literal["gaussian", "symmetric"],
) -> None:
    readings = random_readings(np.random.default_rng(seed), 150, level=level, drift=drift)
    detector = ChangeSettings(
        noise=1.0,
        steps_per_false_alarm=run_length,
        release=release,
        deviations=deviations,
        longest=longest,
        tails=tails,
        cooldown=0,
    )
    traced = trace(detector, readings)
    trigger = ChangeTrigger(detector)
    evidence = []
    for step in range(len(readings)):
        take_in(trigger, readings[step], last=bool(readings.last[step]))
        evidence.append(trigger.evidence)
    np.testing.assert_allclose(traced.evidence, evidence, rtol=1e-9, atol=1e-9)
    assert first_alarm(traced, detector) == step_by_step(ChangeTrigger(detector), readings)


def test_both_routes_find_alarms_and_streams_without() -> None:
    """That the comparison above is not one of nothing with nothing."""
    detector = ChangeSettings(noise=1.0, steps_per_false_alarm=100.0)
    drawn = np.random.default_rng(0)
    found = [
        first_alarm(trace(detector, random_readings(drawn, 150, level=-0.5, drift=drift)), detector)
        for drift in (-0.4, -0.4, -0.4, 0.3, 0.3, 0.3)
    ]
    assert all(step is not None for step in found[:3])
    assert found[3:] == [None] * 3


@pytest.mark.parametrize(("steps", "sliding"), [(None, False), (7, False), (7, True), (500, False)])
def test_windows_of_a_stream(steps: int | None, sliding: bool) -> None:
    readings = random_readings(np.random.default_rng(1), 300, level=0.0, drift=0.0)
    chosen = WindowSettings(threshold=-2.0, discount=0.9, steps=steps, sliding=sliding)
    ends, rewards = window_rewards(chosen, readings)
    trigger = WindowTrigger(chosen)
    found = alarms(trigger, readings)
    assert ends[rewards < -2.0].tolist() == found
    assert len(found) > 3 or steps == 500
