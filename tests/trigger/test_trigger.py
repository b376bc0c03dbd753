"""The trigger on a system that is seen through `reset` and `step` alone, one step at a time."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from merap.concerns.combination import Combination
from merap.mdp.index import index_of
from merap.systems.simulated import SimulatedSystem
from merap.systems.strategy import StateIndex
from merap.trigger.change import ChangeTrigger
from merap.trigger.readings import Forecast
from merap.trigger.settings import ChangeSettings, WindowSettings
from merap.trigger.trigger import Alarm, Trigger
from merap.trigger.window import WindowTrigger
from scripts.bench.trigger_streams import Known, known
from tests.support.hand_made import cells, grid_combination

SLIP, NOISE = 0.1, 0.5
SETTINGS = ChangeSettings(noise=NOISE)


@cache
def before() -> Known:
    return known(grid_combination(goal=(4, 4)), SLIP)


def episode(system: SimulatedSystem, forecast: Forecast, trigger: Trigger) -> Alarm | None:
    """The first alarm of an episode with the known model's policy."""
    number = StateIndex(index_of(before().model))
    here, found = number(system.reset()), None
    for t in range(before().horizon):
        action = int(before().policy[t, here].argmax())
        observation = system.step(action)
        there = number(observation)
        reading = forecast.read_step(t, here, action, there, observation.reward)
        found = found or trigger.observe(reading)
        here = there
        if observation.last:
            break
    return found or trigger.episode_over()


def episodes_until_alarm(trigger: Trigger, after: Combination, seed: int) -> int:
    """Counted from the change, which comes after 30 episodes; 0: it came before; 30: there was none."""
    horizon = before().horizon
    system = SimulatedSystem(
        grid_combination(goal=(4, 4)), horizon, np.random.default_rng(seed), slip=SLIP, noise=NOISE
    )
    forecast = before().forecast(SETTINGS)
    for _ in range(30):
        if episode(system, forecast, trigger) is not None:
            return 0
    system.switch(after)
    return next((n for n in range(1, 30) if episode(system, forecast, trigger) is not None), 30)


def triggers() -> list[Trigger]:
    return [ChangeTrigger(SETTINGS), WindowTrigger(WindowSettings(threshold=-4.0, discount=0.95))]


@pytest.mark.parametrize("seed", range(3))
def test_both_see_that_the_way_is_blocked(seed: int) -> None:
    """The change detector has 3 episodes; 18 steps of -0.5 are worth -5.4, which the window sees at once."""
    way = {2: (1, 0), 4: (0, 1)}[int(before().policy[0, 1].argmax())]
    change, window = triggers()
    after = grid_combination(blocked=cells(way), goal=(4, 4))
    assert 1 <= episodes_until_alarm(change, after, seed) <= 3
    assert 1 <= episodes_until_alarm(window, after, seed) <= 2


def test_neither_minds_what_is_off_the_path() -> None:
    for trigger in triggers():
        assert episodes_until_alarm(trigger, grid_combination(blocked=cells((8, 8)), goal=(4, 4)), 0) == 30
