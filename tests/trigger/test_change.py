"""The change detector: hysteresis, cool-down, budget, and what is no reason to re-plan."""

from __future__ import annotations

import math
from itertools import count, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.trigger.change import ChangeTrigger, Totals, estimated_loss
from merap.trigger.settings import ChangeSettings
from merap.trigger.trigger import Reading
from tests.support.trigger_examples import random_readings, reading, take_in

SETTINGS = ChangeSettings(noise=1.0, cooldown=0)
EPISODE = 5


def episode(ratio: float = 1.0, gain: float = 0.0, reward: float = 0.0) -> list[Reading]:
    """Five steps; what each of them says."""
    return [reading(reward, ratio=ratio, gain=gain) for _ in range(EPISODE)]


def run(trigger: ChangeTrigger, readings: list[Reading], length: int | None = EPISODE) -> list[int]:
    """The steps with an alarm, in episodes of that length; after each alarm a new policy is there."""
    last = [length is not None and step % length == length - 1 for step in range(len(readings))]
    return run_with_ends(trigger, readings, last)


def run_with_ends(trigger: ChangeTrigger, readings: list[Reading], last: list[bool]) -> list[int]:
    alarms = []
    for step, one in enumerate(readings):
        if take_in(trigger, one, last=last[step]) is not None:
            alarms.append(step)
            trigger.replanned()
    return alarms


def test_a_change_that_costs_is_told_when_the_episode_ends() -> None:
    trigger = ChangeTrigger(SETTINGS)
    assert run(trigger, [one for _ in range(20) for one in episode(ratio=0.8)]) == []
    # each step multiplies the detectors of transitions by e^7 (the cap) or nearly so: two would do
    assert run(trigger, episode(ratio=1e6, gain=-1.0)) == [EPISODE - 1]


def test_the_alarm_says_why() -> None:
    trigger = ChangeTrigger(SETTINGS)
    for one in episode(ratio=0.8):
        trigger.observe(one)
    assert trigger.episode_over() is None
    for one in episode(ratio=1e6, gain=-1.0):
        assert trigger.observe(one) is None
    alarm = trigger.episode_over()
    assert alarm is not None
    assert alarm.kind == "change"
    assert alarm.threshold == pytest.approx(math.log(1e6))
    assert alarm.statistic > alarm.threshold
    assert "has not held for the last 5 steps" in alarm.reason
    assert "an episode earns 5 less than the 10 expected" in alarm.reason


def test_a_change_that_costs_nothing_is_no_reason() -> None:
    """The model is wrong beyond doubt, gains cancel out within the episode."""
    trigger = ChangeTrigger(SETTINGS)
    balanced = [reading(ratio=1e6, gain=-1.0 if step < 2 else 2 / 3) for step in range(EPISODE)]
    assert run(trigger, balanced * 40) == []
    assert trigger.suspicious


def test_a_loss_without_evidence_is_no_reason() -> None:
    assert run(ChangeTrigger(SETTINGS), [one for _ in range(40) for one in episode(gain=-1.0)]) == []


@pytest.mark.parametrize(("loss", "expected"), [(0.9, False), (1.1, True)])
def test_a_loss_within_what_is_tolerated_is_no_reason(loss: float, expected: bool) -> None:
    """10 % of a value of 10 is 1 an episode; with 400 episodes the estimate is sharp."""
    settings = ChangeSettings(noise=1.0, cooldown=0, deviations=1.0)
    readings = [one for _ in range(400) for one in episode(ratio=1e6, gain=-loss / EPISODE)]
    assert (len(run(ChangeTrigger(settings), readings)) > 0) == expected


def test_a_better_reward_hides_no_loss_unless_it_makes_up_for_it() -> None:
    part = Totals(steps=10, episodes=1, gain=-4.0, gain_variance=1.0, residual=5.0)
    settings = ChangeSettings(noise=1.0, tolerated_loss=0.0)
    # noise of ten steps: sqrt(10) = 3.16; 5 is within two of them, and is taken for noise
    assert estimated_loss(part, 10.0, settings).deviations == pytest.approx(4.0)
    shifted = Totals(steps=10, episodes=1, gain=-4.0, gain_variance=1.0, residual=7.0)
    assert estimated_loss(shifted, 10.0, settings).deviations == pytest.approx(-3.0 / math.sqrt(11.0))


def test_without_variance_a_loss_is_certain() -> None:
    part = Totals(steps=10, episodes=1, gain=-1.1)
    assert estimated_loss(part, 10.0, SETTINGS).deviations == math.inf
    assert estimated_loss(Totals(10, 1, -0.9), 10.0, SETTINGS).deviations == -math.inf


def test_a_suspicion_outlasts_the_peak_and_is_dropped_well_below_it() -> None:
    """Hysteresis: up at log 1e6 = 13.8; with `release` 0.5 it is dropped below 6.9."""
    trigger = ChangeTrigger(SETTINGS)
    for one in episode(ratio=1e6):
        trigger.observe(one)
    peak = trigger.evidence
    assert peak > math.log(1e6)
    for _ in count():
        trigger.observe(reading(ratio=0.5))
        if not trigger.suspicious:
            break
        assert trigger.evidence >= 0.5 * math.log(1e6)
    assert trigger.evidence < 0.5 * math.log(1e6)


def test_cool_down_and_budget_bound_the_number_of_re_plannings() -> None:
    bad = [one for _ in range(100) for one in episode(ratio=1e6, gain=-1.0)]
    assert run(ChangeTrigger(SETTINGS.model_copy(update={"budget": 100})), bad[:50]) == list(range(4, 50, 5))
    cooled = ChangeTrigger(SETTINGS.model_copy(update={"budget": 100, "cooldown": 2}))
    # the first is told at once; after each, two episodes pass without an alarm
    assert run(cooled, bad[:50]) == [4, 19, 34, 49]
    limited = ChangeTrigger(SETTINGS.model_copy(update={"budget": 3, "budget_steps": 200}))
    # three at once; each is back 200 steps later
    assert run(limited, bad) == [4, 9, 14, 204, 209, 214, 404, 409, 414]


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    budget=st.integers(1, 4),
    budget_steps=st.integers(1, 120),
    cooldown=st.integers(0, 3),
)
def test_no_stream_gets_around_cool_down_and_budget(
    seed: int, budget: int, budget_steps: int, cooldown: int
) -> None:
    """Whatever is read: alarms are where episodes end, far enough apart, and few enough."""
    limits = {"budget": budget, "budget_steps": budget_steps, "cooldown": cooldown, "max_evidence": 30.0}
    trigger = ChangeTrigger(SETTINGS.model_copy(update=limits))
    readings = random_readings(np.random.default_rng(seed), 250, level=2.0, drift=-2.0)
    alarms = run_with_ends(trigger, [readings[step] for step in range(250)], readings.last.tolist())
    ends = np.flatnonzero(readings.last).tolist()
    assert set(alarms) <= set(ends)
    places = [ends.index(step) for step in alarms]
    assert all(later - earlier > cooldown for earlier, later in pairwise(places))
    for step in alarms:
        assert sum(step - budget_steps < other <= step for other in alarms) <= budget


def test_an_episode_without_end_is_judged_all_the_same() -> None:
    settings = SETTINGS.model_copy(update={"longest": 7})
    endless = [reading(ratio=1e6, gain=-1.0) for _ in range(20)]
    assert run(ChangeTrigger(settings), endless, None) == [6, 13]


def test_an_episode_that_lasts_as_long_as_is_waited_for_ends_once() -> None:
    """The cool-down of two episodes passes in two, not in one that is over twice."""
    trigger = ChangeTrigger(SETTINGS.model_copy(update={"longest": EPISODE, "cooldown": 2, "budget": 9}))
    bad = [one for _ in range(7) for one in episode(ratio=1e6, gain=-1.0)]
    assert run(trigger, bad) == [4, 19, 34]


def test_what_an_episode_may_lose_does_not_depend_on_whether_its_last_step_was_seen() -> None:
    """1 is tolerated; each loses 0.8. With 2 standard deviations two episodes in one would be told."""
    settings = SETTINGS.model_copy(update={"deviations": 2.0})
    whole, cut = ChangeTrigger(settings), ChangeTrigger(settings)
    for _ in range(4):
        for one in episode(ratio=1e6, gain=-0.2)[:-1]:
            assert whole.observe(one) is None
            assert cut.observe(one) is None
        assert whole.observe(reading(ratio=1e6)) is None
        cut.missed()
        assert whole.episode_over() is None
        assert cut.episode_over() is None
    assert cut.suspicious


def test_an_episode_of_which_nothing_was_seen_counts_as_none() -> None:
    trigger = ChangeTrigger(SETTINGS.model_copy(update={"cooldown": 2, "budget": 9}))
    bad = episode(ratio=1e6, gain=-1.0)
    assert run(trigger, bad) == [EPISODE - 1]
    for _ in range(5):
        trigger.missed()
        assert trigger.episode_over() is None
    # two more are to pass
    assert run(trigger, bad * 3) == [3 * EPISODE - 1]


def test_re_planning_forgets_the_evidence() -> None:
    trigger = ChangeTrigger(SETTINGS)
    run(trigger, episode(ratio=1e6, gain=-1.0))
    assert trigger.evidence == -math.inf
    assert not trigger.suspicious
