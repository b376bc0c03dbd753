"""Curves of delay against false alarms: what thresholds trade."""

from __future__ import annotations

import numpy as np

from merap.trigger.settings import WindowSettings
from scripts.bench.trigger_batch import window_rewards
from scripts.bench.trigger_curve import change_curve, window_curve
from scripts.bench.trigger_delay import Change, World, unchanged, watch
from scripts.bench.trigger_streams import effect, known
from tests.support.hand_made import cells, grid_combination

WORLD = World()


def test_thresholds_trade_false_alarms_for_delay_and_the_change_detector_does_better() -> None:
    """One cell before the goal is blocked: -0.5 a step from there on, and the goal's 10 are lost."""
    before = known(grid_combination(goal=(0, 4)), WORLD.slip)
    real = WORLD.model(grid_combination(blocked=cells((0, 3)), goal=(0, 4)))
    generator = np.random.default_rng(0)
    quiet = [unchanged(before, before.model, WORLD, 20_000, generator)]
    watched = watch(Change("", before, before.model, real, effect(before, real)), WORLD, 10, 20, generator)
    detector = change_curve(WORLD.settings, quiet, [watched], [3.0, 8.0, 16.1, 60.0], longest=20)
    assert [point.threshold for point in detector] == [3.0, 8.0, 16.1, 60.0]
    alarms, delays = ([getattr(point, name) for point in detector] for name in ("false_alarms", "delay"))
    assert alarms == sorted(alarms, reverse=True)
    assert delays == sorted(delays)
    assert alarms[0] > 0
    settings = WindowSettings(threshold=0.0)
    ends, rewards = window_rewards(settings, quiet[0])
    assert len(ends) > 1000
    paper = window_curve(settings, quiet, [(watched, float(rewards.mean()))], [0.0, 5.0, 50.0], longest=20)
    # half of the episodes are below their mean: 10^5 steps have that many episodes of the mean length
    assert paper[0].false_alarms == np.sum(rewards < rewards.mean()) * 5
    assert [point.soon for point in paper] == [1.0, 1.0, 0.0]
    assert (paper[2].false_alarms, paper[2].delay) == (0.0, 20.0)
    best = detector[2]
    assert best.false_alarms == 0
    assert best.soon == 1.0
