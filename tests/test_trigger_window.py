"""The paper's trigger, by its formula."""

from __future__ import annotations

from collections.abc import Container

import pytest

from merap.online.trigger.settings import WindowSettings
from merap.online.trigger.window import WindowTrigger
from tests.trigger_examples import reading


def alarms(trigger: WindowTrigger, rewards: list[float], last: Container[int] = ()) -> list[int]:
    return [
        step
        for step, reward in enumerate(rewards)
        if trigger.observe(reading(reward, last=step in last)) is not None
    ]


def test_t_counts_from_the_start_of_the_window() -> None:
    """1 + 0.5 + 0.25 = 1.75 in each window of three; counted from the beginning the second has 1/8 of it."""
    settings = WindowSettings(threshold=1.75, discount=0.5, steps=3)
    assert alarms(WindowTrigger(settings), [1.0] * 9) == []
    settings = WindowSettings(threshold=1.76, discount=0.5, steps=3)
    assert alarms(WindowTrigger(settings), [1.0] * 9) == [2, 5, 8]


def test_the_statistic_is_the_discounted_reward() -> None:
    trigger = WindowTrigger(WindowSettings(threshold=10.0, discount=0.9, steps=2))
    assert trigger.observe(reading(1.0)) is None
    alarm = trigger.observe(reading(2.0))
    assert alarm is not None
    assert (alarm.kind, alarm.threshold) == ("threshold", 10.0)
    assert alarm.statistic == pytest.approx(1.0 + 0.9 * 2.0)
    assert alarm.reason == "the discounted reward of the last 2 steps is 2.8, below the threshold of 10"


def test_a_window_is_an_episode_if_nothing_else_is_said() -> None:
    settings = WindowSettings(threshold=2.5, discount=1.0)
    # episodes of 3, 2 and 3 steps: only the second earns too little
    assert alarms(WindowTrigger(settings), [1.0] * 8, {2, 4, 7}) == [4]


def test_sliding_windows_end_at_every_step() -> None:
    settings = WindowSettings(threshold=1.5, discount=1.0, steps=2, sliding=True)
    assert alarms(WindowTrigger(settings), [1.0, 1.0, 0.0, 1.0, 1.0, 0.0]) == [2, 3, 5]


def test_re_planning_begins_a_new_window() -> None:
    trigger = WindowTrigger(WindowSettings(threshold=1.0, discount=1.0, steps=2))
    assert trigger.observe(reading(-5.0)) is None
    trigger.replanned()
    assert alarms(trigger, [1.0, 0.5, 1.0]) == []
