"""The paper's trigger, by its formula."""

from __future__ import annotations

from collections.abc import Container

import pytest

from merap.trigger.settings import WindowSettings
from merap.trigger.window import WindowTrigger
from tests.support.trigger_examples import reading, take_in


def alarms(trigger: WindowTrigger, rewards: list[float], last: Container[int] = ()) -> list[int]:
    return [
        step
        for step, reward in enumerate(rewards)
        if take_in(trigger, reading(reward), last=step in last) is not None
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


def test_episodes_whose_last_step_was_not_seen_are_told_apart() -> None:
    """Three of 10 steps at -0.5, TR -6: an episode earns -5, two in one would earn less than TR."""
    trigger = WindowTrigger(WindowSettings(threshold=-6.0, discount=1.0))
    for seen in (9, 9, 10):
        assert alarms(trigger, [-0.5] * seen) == []
        if seen < 10:
            trigger.missed()
        assert trigger.episode_over() is None


def test_an_episode_with_a_reward_that_is_not_known_is_not_judged() -> None:
    """Not even one whose known rewards alone are below TR: the missed one may have paid for them."""
    trigger = WindowTrigger(WindowSettings(threshold=-2.0, discount=1.0))
    assert alarms(trigger, [-1.0, -1.0]) == []
    trigger.missed()
    assert alarms(trigger, [-1.0], {0}) == []
    # the next one is whole
    assert alarms(trigger, [-1.0] * 3, {2}) == [2]


def test_an_episode_of_which_nothing_was_seen_is_not_judged() -> None:
    """A system that could not be reset; a TR above 0 would else be missed by the empty sum."""
    assert WindowTrigger(WindowSettings(threshold=1.0)).episode_over() is None


def test_a_window_of_steps_begins_anew_after_a_missed_one() -> None:
    trigger = WindowTrigger(WindowSettings(threshold=-2.5, discount=1.0, steps=3))
    assert alarms(trigger, [-1.0, -1.0]) == []
    trigger.missed()
    assert alarms(trigger, [-1.0, -1.0, -1.0]) == [2]


@pytest.mark.parametrize("sliding", [False, True])
def test_a_window_of_steps_goes_on_in_the_next_episode(sliding: bool) -> None:
    trigger = WindowTrigger(WindowSettings(threshold=-2.5, discount=1.0, steps=3, sliding=sliding))
    assert alarms(trigger, [-1.0, -1.0], {1}) == []
    assert alarms(trigger, [-1.0]) == [0]


def test_sliding_windows_end_at_every_step() -> None:
    settings = WindowSettings(threshold=1.5, discount=1.0, steps=2, sliding=True)
    assert alarms(WindowTrigger(settings), [1.0, 1.0, 0.0, 1.0, 1.0, 0.0]) == [2, 3, 5]


def test_re_planning_begins_a_new_window() -> None:
    trigger = WindowTrigger(WindowSettings(threshold=1.0, discount=1.0, steps=2))
    assert trigger.observe(reading(-5.0)) is None
    trigger.replanned()
    assert alarms(trigger, [1.0, 0.5, 1.0]) == []


def test_re_planning_begins_a_whole_episode() -> None:
    trigger = WindowTrigger(WindowSettings(threshold=1.0, discount=1.0))
    trigger.missed()
    trigger.replanned()
    assert alarms(trigger, [0.0], {0}) == [0]
