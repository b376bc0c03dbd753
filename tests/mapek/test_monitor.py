from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from merap.mapek.messages import Execution, Monitored
from merap.mapek.monitor import Monitor, Sensors
from merap.mapek.scenario_schema import SensingSpec
from merap.mdp.index import FamilyIndex
from merap.systems.sightings import Sighting, Transition
from tests.support.loop_examples import NUM_ACTIONS, seen

RIGHT, DOWN = 4, 2
COMPLETED = 81
DRAWS = 4000


def monitor(delay: int = 0) -> Monitor:
    cells = np.arange(COMPLETED)
    valuations = np.vstack([np.stack([cells // 9, cells % 9, 0 * cells], axis=1), [[-1, -1, -1]]])
    completed = {frozenset[str](): COMPLETED}
    index = FamilyIndex(("row", "col", "mode"), valuations, completed, ("a",) * NUM_ACTIONS)
    return Monitor(index, NUM_ACTIONS, Sensors(SensingSpec(delay=delay), np.random.default_rng(0)))


def news(monitored: Monitored) -> list[tuple[int, ...]]:
    """(state,) of what was sighted, (state, action, target) of what was seen whole."""
    return [
        (one.state,) if isinstance(one, Sighting) else (one.state, one.action, one.target)
        for one in monitored.news
    ]


def test_a_step_that_is_seen_is_a_transition() -> None:
    watching = monitor()
    first = watching.receive(Execution(None, seen(0, 0, 0.0)))
    assert (first.episode, first.step, news(first), first.state, first.last) == (0, 0, [(0,)], 0, False)
    second = watching.receive(Execution(RIGHT, seen(0, 1)))
    assert (second.step, news(second), second.state, second.since) == (1, [(0, RIGHT, 1)], 1, ())
    transition = second.news[0]
    assert isinstance(transition, Transition)
    assert transition.observation.reward == -0.5


def test_the_end_of_the_task_is_the_completed_state() -> None:
    watching = monitor()
    watching.receive(Execution(None, seen(0, 0, 0.0)))
    ended = watching.receive(Execution(0, seen(-1, -1, 10.0, ended=True)))
    assert (news(ended), ended.state, ended.last) == ([(0, 0, COMPLETED)], COMPLETED, True)
    again = watching.receive(Execution(None, seen(0, 0, 0.0)))
    assert (again.episode, again.step, again.last) == (1, 0, False)


def test_what_is_late_is_put_where_it_belongs() -> None:
    """One step late: the system is where it was seen last, and moved once since."""
    watching = monitor(delay=1)
    first = watching.receive(Execution(None, seen(0, 0, 0.0)))
    assert (first.news, first.state, first.seen) == ((), None, None)
    second = watching.receive(Execution(RIGHT, seen(0, 1)))
    assert (news(second), second.state, second.seen, second.since) == ([(0,)], None, 0, (RIGHT,))
    third = watching.receive(Execution(DOWN, seen(1, 1)))
    assert (news(third), third.state, third.seen, third.since) == ([(0, RIGHT, 1)], None, 1, (DOWN,))
    last = watching.receive(Execution(DOWN, seen(2, 1, truncated=True)))
    assert news(last) == [(1, DOWN, 10), (10, DOWN, 19)]
    assert (last.state, last.last) == (19, True)


def test_an_episode_counts_its_own_actions_from_its_start() -> None:
    """Nothing is seen of it yet; the episode before was seen up to its second step."""
    watching = monitor(delay=2)
    watching.receive(Execution(None, seen(0, 0, 0.0)))
    watching.receive(Execution(RIGHT, seen(0, 1)))
    watching.receive(Execution(RIGHT, seen(0, 2, truncated=True)))
    watching.receive(Execution(None, seen(0, 0, 0.0)))
    found = watching.receive(Execution(DOWN, seen(1, 0)))
    assert (found.seen, found.since) == (None, (DOWN,))


def test_after_a_gap_a_state_is_sighted_and_no_transition_made_up() -> None:
    watching = monitor()
    watching.receive(Execution(None, seen(0, 0, 0.0)))
    gap = watching.receive(Execution(RIGHT, None, "no answer within 1 s"))
    assert (gap.news, gap.state, gap.seen, gap.since) == ((), None, 0, (RIGHT,))
    assert gap.problems == ("no answer within 1 s",)
    assert not gap.last
    after = watching.receive(Execution(RIGHT, seen(0, 2)))
    assert (news(after), after.state, after.since, after.problems) == ([(2,)], 2, (), ())
    assert [one.time for one in after.news] == [2]


def test_a_state_that_the_case_does_not_have_counts_as_not_seen() -> None:
    watching = monitor()
    watching.receive(Execution(None, seen(0, 0, 0.0)))
    rubbish = watching.receive(Execution(RIGHT, seen(77, 5)))
    assert (rubbish.news, rubbish.state) == ((), None)
    assert rubbish.problems == ("the observed state (77, 5, 0) is none of the 81 known ones",)
    assert news(watching.receive(Execution(RIGHT, seen(0, 2)))) == [(2,)]


def test_what_is_enabled_arrives_even_when_the_rest_is_late() -> None:
    watching = monitor(delay=3)
    enabled = (True, False, False, False, True)
    found = watching.receive(Execution(None, seen(0, 0, enabled=enabled)))
    assert found.enabled.tolist() == list(enabled)
    kept = watching.receive(Execution(RIGHT, None, "no answer"))
    assert kept.enabled.tolist() == list(enabled)


def test_an_episode_that_was_given_up_is_over() -> None:
    watching = monitor()
    over = watching.receive(Execution(None, None, "refused", over=True))
    assert over.last
    assert not watching.receive(Execution(None, seen(0, 0, 0.0))).last


def test_the_action_is_the_one_that_the_system_has_taken() -> None:
    """What stands in between may have fallen back on another one."""
    watching = monitor()
    watching.receive(Execution(None, seen(0, 0, 0.0)))
    fallen_back = watching.receive(Execution(DOWN, replace(seen(1, 0), taken=DOWN)))
    assert news(fallen_back) == [(0, DOWN, 9)]


def sensors(delay: int = 0, loss: float = 0.0, seed: int = 0) -> Sensors:
    return Sensors(SensingSpec(delay=delay, loss=loss), np.random.default_rng(seed))


def arrivals(passing: Sensors, steps: int, *, ends: bool = True) -> list[list[int]]:
    """Of an episode: which observations arrive after each step."""
    passing.clear()
    return [
        [one.step for one in passing.deliver(step, seen(0, 0, truncated=ends and step == steps))]
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
    passing.clear()
    assert passing.deliver(0, seen(0, 0)) == ()
    assert [one.step for one in passing.deliver(1, None)] == [0]
    assert passing.deliver(2, None) == ()


def test_as_many_are_lost_as_declared_but_never_the_last() -> None:
    """4 standard deviations of a binomial: fails by luck once in 16,000."""
    loss = 0.3
    found = arrivals(sensors(loss=loss), DRAWS)
    lost = DRAWS - sum(map(len, found[:-1]))
    assert abs(lost - loss * DRAWS) <= 4 * math.sqrt(DRAWS * loss * (1 - loss))
    assert found[-1] == [DRAWS]
