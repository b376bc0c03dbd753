from __future__ import annotations

import math

import numpy as np

from merap.mapek.scenario_schema import SensingSpec
from merap.mapek.sensors import Sensors
from tests.support.loop_examples import seen

DRAWS = 4000


def sensors(delay: int = 0, loss: float = 0.0, seed: int = 0) -> Sensors:
    return Sensors(SensingSpec(delay=delay, loss=loss), np.random.default_rng(seed))


def arrivals(passing: Sensors, steps: int, *, ends: bool = True) -> list[list[int]]:
    """Of an episode: which observations arrive after each step."""
    passing.begin()
    return [
        [one.step for one in passing.pass_on(step, seen(0, 0, truncated=ends and step == steps))]
        for step in range(steps + 1)
    ]


def test_nothing_is_in_the_way() -> None:
    assert arrivals(sensors(), 3) == [[0], [1], [2], [3]]


def test_what_is_delayed_arrives_in_order_and_the_rest_with_the_last() -> None:
    assert arrivals(sensors(delay=2), 4) == [[], [], [0], [1], [2, 3, 4]]


def test_a_new_episode_knows_nothing_of_the_one_before() -> None:
    passing = sensors(delay=2)
    assert arrivals(passing, 2, ends=False) == [[], [], [0]]
    assert arrivals(passing, 2, ends=False) == [[], [], [0]]


def test_a_system_that_does_not_answer_has_nothing_to_pass_on() -> None:
    passing = sensors(delay=1)
    passing.begin()
    assert passing.pass_on(0, seen(0, 0)) == ()
    assert [one.step for one in passing.pass_on(1, None)] == [0]
    assert passing.pass_on(2, None) == ()


def test_as_many_are_lost_as_declared_but_never_the_last() -> None:
    """4 standard deviations of a binomial: fails by luck once in 16,000."""
    loss = 0.3
    found = arrivals(sensors(loss=loss), DRAWS)
    lost = DRAWS - sum(map(len, found[:-1]))
    assert abs(lost - loss * DRAWS) <= 4 * math.sqrt(DRAWS * loss * (1 - loss))
    assert found[-1] == [DRAWS]
