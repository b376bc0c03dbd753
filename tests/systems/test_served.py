from __future__ import annotations

from http import HTTPStatus

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from merap.errors import InputError
from merap.systems.description import Interface, Json, ShownVariable
from merap.systems.interface import Observation
from merap.systems.served import Pace, RefusedRequestError, ServedSystem

ACTIONS = ("stop", "go")


class Counting:
    """Counts what it is told; every fifth step ends the task."""

    actions = ACTIONS

    def __init__(self) -> None:
        self.told: list[str] = []
        self.steps = 0

    def reset(self) -> Observation:
        self.told.append("reset")
        self.steps = 0
        return self._seen()

    def step(self, action: int) -> Observation:
        self.told.append(ACTIONS[action])
        self.steps += 1
        return self._seen()

    def _seen(self) -> Observation:
        over = self.steps == 5
        enabled = np.full(2, not over)
        return Observation(np.array([self.steps]), enabled, 1.0, 0.0 if over else 1.0, False)


COUNTED = Interface("counting", ACTIONS, (ShownVariable("count", -1, 5),))


def counting() -> tuple[Counting, ServedSystem]:
    system = Counting()
    return system, ServedSystem(system, COUNTED)


requests = st.one_of(
    st.fixed_dictionaries({"action": st.sampled_from(ACTIONS)}),
    st.just({"reset": True}),
    st.tuples(
        st.one_of(st.fixed_dictionaries({"action": st.sampled_from(ACTIONS)}), st.just({"reset": True})),
        st.integers(1, 4),
        st.integers(0, 6),
    ).map(lambda drawn: {**drawn[0], "episode": drawn[1], "step": drawn[2]}),
)


def executed(served: ServedSystem, request: Json) -> Json | HTTPStatus:
    try:
        return served.execute(request)
    except RefusedRequestError as refused:
        return refused.status


@settings(max_examples=200, deadline=None)
@given(st.lists(requests, max_size=40))
def test_counters_go_on_by_one_with_every_change_and_with_nothing_else(asked: list[Json]) -> None:
    """A request changes the system once or not at all; with counters only at those, or it has been done."""
    system, served = counting()
    last: Json | None = None
    for request in asked:
        before, told = served.monitor(), len(system.told)
        now = {"episode": before["episode"], "step": before["step"]}
        answer = executed(served, request)
        if isinstance(answer, HTTPStatus):
            assert answer == HTTPStatus.CONFLICT
            assert served.monitor() == before
            assert len(system.told) == told
        elif {**now, **request} != {**request, **now}:
            assert request == last
            assert served.monitor() == before
            assert len(system.told) == told
        else:
            assert len(system.told) == told + 1
            last = {**request, **now}
    assert system.told.count("reset") == served.monitor()["episode"]


def test_a_system_with_other_actions_is_refused() -> None:
    with pytest.raises(InputError, match="has the actions"):
        ServedSystem(Counting(), Interface("other", ("stop",), ()))


def test_a_system_that_fails_stays_where_it_was() -> None:
    class Failing(Counting):
        def step(self, action: int) -> Observation:
            raise InputError("no power")

    served = ServedSystem(Failing(), COUNTED)
    before = served.monitor()
    with pytest.raises(InputError, match="no power"):
        served.execute({"action": "go"})
    assert served.monitor() == before


def test_rewards_of_an_episode_add_up() -> None:
    _, served = counting()
    for _ in range(3):
        served.execute({"action": "go"})
    assert served.monitor()["total"] == 3
    served.execute({"reset": True})
    assert served.monitor()["total"] == 0


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def paced() -> tuple[Clock, Counting, ServedSystem]:
    clock, system = Clock(), Counting()
    return clock, system, ServedSystem(system, COUNTED, pace=Pace(2.0, "stop"), clock=clock)


def test_a_system_with_a_pace_does_not_wait_for_a_late_manager() -> None:
    clock, system, served = paced()
    clock.now += 1.9
    served.execute({"action": "go"})
    clock.now += 4.1  # two deadlines have passed, and 0.1 s of the third
    assert served.monitor()["action"] == "stop"
    assert system.told == ["reset", "go", "stop", "stop"]
    clock.now += 1.8
    served.execute({"action": "go"})
    assert system.told[-1] == "go"
    assert served.monitor()["total"] == 4


def test_a_decision_that_is_late_is_refused_and_the_fallback_is_seen() -> None:
    clock, system, served = paced()
    clock.now += 2.5
    assert executed(served, {"action": "go", "episode": 1, "step": 0}) == HTTPStatus.CONFLICT
    assert (served.monitor()["action"], served.monitor()["step"]) == ("stop", 1)
    assert system.told == ["reset", "stop"]


def test_a_paced_system_waits_where_nothing_can_be_done() -> None:
    """The episode is over after five steps; then it waits for its reset, from which it counts again."""
    clock, system, served = paced()
    clock.now += 1000
    assert served.monitor()["step"] == 5
    served.execute({"reset": True})
    clock.now += 1
    assert served.monitor()["step"] == 0
    assert system.told == ["reset", *["stop"] * 5, "reset"]


@pytest.mark.parametrize("pace", [Pace(0, "stop"), Pace(float("nan"), "stop"), Pace(1, "flee")])
def test_a_pace_that_makes_no_sense_is_refused(pace: Pace) -> None:
    with pytest.raises(InputError, match=r"a deadline is a positive number|no action 'flee' to fall back on"):
        ServedSystem(Counting(), COUNTED, pace=pace)
