from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from merap.errors import InputError
from merap.families.loading import load_case
from merap.systems.description import Json, interface_of
from merap.systems.dialect import MonitoredState
from merap.systems.http_client import UpisasClient
from merap.systems.http_system import HttpSystem
from merap.systems.interface import Observation, SystemFault
from merap.systems.served import Pace, ServedSystem
from merap.systems.served_dialect import open_served
from merap.systems.simulated import SimulatedSystem
from tests.support.hand_made import grid_combination
from tests.support.http_servers import (
    FlakyServer,
    Mishap,
    raw_server,
    read_request,
    response,
    served_system,
    serving,
)

RUNNING = "models/running-example"
STOP, UP, DOWN, LEFT, RIGHT = range(5)


@contextmanager
def flaky(*mishaps: Mishap) -> Iterator[tuple[HttpSystem, FlakyServer]]:
    """A system that has begun an episode, whose next requests have these mishaps."""
    server = FlakyServer(served_system(grid_combination(goal=(0, 2))), iter(()))
    with raw_server(server) as url, open_served(url, timeout=10) as system:
        system.reset()
        server.mishaps = iter(mishaps)
        yield system, server


def steps_of(served: ServedSystem) -> int:
    return int(served.monitor()["step"])


def content(seen: Observation) -> tuple[object, ...]:
    arrays = (seen.valuation.tolist(), seen.enabled.tolist())
    return (*arrays, seen.reward, seen.continuation, seen.truncated, seen.detections, seen.taken)


def test_a_system_behind_http_is_the_system() -> None:
    """The same seed here and there gives the same episode, detections included."""
    met = load_case(RUNNING).system("met")
    here = SimulatedSystem(met, met.objective.horizon, np.random.default_rng(5), detect=True)
    here.reset()  # the server has begun its first episode when it is asked for another one
    generator = np.random.default_rng(0)
    with serving(met, seed=5, detect=True) as url, open_served(url, timeout=10) as there:
        assert there.actions == here.actions
        one, other = here.reset(), there.reset()
        assert content(one) == content(other)
        for _ in range(12):
            action = int(generator.choice(np.flatnonzero(one.enabled)))
            one, other = here.step(action), there.step(action)
            assert content(one) == content(other)


def test_actions_and_variables_are_in_the_order_of_the_manager() -> None:
    with (
        serving(grid_combination(goal=(0, 2))) as url,
        open_served(
            url, timeout=10, actions=("right", "left", "down", "up", "stop"), variables=("mode", "col", "row")
        ) as system,
    ):
        system.reset()
        assert system.step(0).valuation.tolist() == [0, 1, 0]


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"actions": ("stop", "go")}, "has the actions stop, up, down, left, right; expected stop, go"),
        ({"variables": ("loc", "mode")}, "has the variables row, col, mode; expected loc, mode"),
    ],
)
def test_a_system_of_another_case_is_refused(wanted: dict[str, tuple[str, ...]], message: str) -> None:
    with serving(grid_combination()) as url, pytest.raises(InputError, match=message):
        open_served(url, timeout=10, **wanted)


def test_an_action_that_is_none_is_refused_here() -> None:
    with flaky() as (system, server):
        with pytest.raises(InputError, match="there is no action 5, only 0 to 4"):
            system.step(5)
        assert steps_of(server.served) == 0


def test_a_system_begins_with_a_reset() -> None:
    with (
        serving(grid_combination()) as url,
        open_served(url, timeout=10) as system,
        pytest.raises(InputError, match="reset the system first"),
    ):
        system.step(STOP)


@pytest.mark.parametrize("mishap", ["lost", "answer lost", "failed", "rubbish"])
@pytest.mark.parametrize("request_number", [0, 1])
def test_a_step_that_is_repeated_after_a_fault_acts_once(mishap: Mishap, request_number: int) -> None:
    """Request 0 is the PUT, request 1 the look at what it has led to."""
    mishaps: list[Mishap] = ["none", "none"]
    mishaps[request_number] = mishap
    with flaky(*mishaps) as (system, server):
        with pytest.raises(SystemFault) as caught:
            system.step(RIGHT)
        assert caught.value.repeatable
        found = system.step(RIGHT)
        assert found.valuation.tolist() == [0, 1, 0]
        assert found.taken is None
        assert steps_of(server.served) == 1
        assert system.step(RIGHT).valuation.tolist() == [0, 2, 0]


@pytest.mark.parametrize("mishap", ["lost", "answer lost", "failed", "rubbish"])
@pytest.mark.parametrize("request_number", [0, 1])
def test_a_repeated_reset_begins_one_episode(mishap: Mishap, request_number: int) -> None:
    mishaps: list[Mishap] = ["none", "none"]
    mishaps[request_number] = mishap
    with flaky(*mishaps) as (system, server):
        with pytest.raises(SystemFault):
            system.reset()
        assert system.reset().valuation.tolist() == [0, 0, 0]
        assert server.served.monitor()["episode"] == 3


def test_another_action_after_a_lost_answer_is_not_taken_too() -> None:
    """The manager falls back on `stop`, not knowing that the system has gone right already."""
    with flaky("answer lost") as (system, server):
        with pytest.raises(SystemFault):
            system.step(RIGHT)
        found = system.step(STOP)
        assert found.taken == RIGHT
        assert found.valuation.tolist() == [0, 1, 0]
        assert steps_of(server.served) == 1


def test_another_action_after_a_lost_request_is_taken() -> None:
    with flaky("lost") as (system, server):
        with pytest.raises(SystemFault):
            system.step(RIGHT)
        found = system.step(STOP)
        assert found.taken is None
        assert found.valuation.tolist() == [0, 0, 0]
        assert steps_of(server.served) == 1


def test_a_refused_action_does_nothing_and_the_episode_goes_on() -> None:
    met = load_case(RUNNING).system("met")
    with serving(met) as url, open_served(url, timeout=10) as system:
        system.reset()
        with pytest.raises(SystemFault, match="'measure' is not enabled now; enabled are stop") as caught:
            system.step(system.actions.index("measure"))
        assert (caught.value.kind, caught.value.repeatable) == ("rejected", False)
        assert system.step(system.actions.index("stop")).reward == -1


def test_a_system_with_another_manager_is_told_and_a_reset_goes_on() -> None:
    with flaky() as (system, server):
        server.served.execute({"action": "down"})
        server.served.execute({"action": "down"})
        with pytest.raises(SystemFault, match="expected step 1 of episode 2, it is at step 2") as caught:
            system.step(RIGHT)
        assert (caught.value.kind, caught.value.repeatable) == ("missed", False)
        with pytest.raises(InputError, match="reset"):
            system.step(RIGHT)
        assert system.reset().valuation.tolist() == [0, 0, 0]
        assert system.step(RIGHT).valuation.tolist() == [0, 1, 0]


def test_one_step_of_another_manager_is_seen_as_what_was_taken() -> None:
    with flaky() as (system, server):
        server.served.execute({"action": "down"})
        found = system.step(RIGHT)
        assert found.taken == DOWN
        assert found.valuation.tolist() == [1, 0, 0]


def test_a_foreign_system_is_no_served_one() -> None:
    with raw_server(demo_exemplar([])) as url, pytest.raises(SystemFault, match="not those of `merap serve`"):
        open_served(url, timeout=10)


def test_a_manager_that_is_late_sees_what_the_system_has_done_without_it() -> None:
    """The system falls back on `down` after a minute: once, which is told; then twice, which is too much."""
    combination, clock = grid_combination(goal=(0, 2)), 0.0
    paced = ServedSystem(
        SimulatedSystem(combination, 18, np.random.default_rng(0)),
        interface_of(combination, detect=False),
        pace=Pace(60.0, "down"),
        clock=lambda: clock,
    )
    with raw_server(FlakyServer(paced, iter(()))) as url, open_served(url, timeout=10) as system:
        system.reset()
        clock = 61.0
        found = system.step(RIGHT)
        assert (found.taken, found.valuation.tolist()) == (DOWN, [1, 0, 0])
        clock = 200.0
        with pytest.raises(SystemFault, match=r"missed: .* it is at step 3 of episode 2"):
            system.step(RIGHT)


Numbers = list[float]


class DemoDialect:
    """The demo exemplar of UPISAS: y = x^2 is to be made small, x can be set; there is no reset."""

    actions = ("-1", "0", "1")

    def read(self, monitored: Mapping[str, Any]) -> MonitoredState:
        value = float(monitored["f"])
        cell = np.array([round(value)])
        return MonitoredState(Observation(cell, np.ones(3, dtype=np.bool_), -value, 1.0, False))

    def change(self, action: int | None, last: MonitoredState | None) -> Json | None:
        return None if action is None else {"x": float(self.actions[action])}


DEMO = DemoDialect()


def demo_exemplar(changes: Numbers, lost: int = 0) -> Any:
    """Counts nothing; the answers to the first `lost` changes are lost."""
    schemas = {
        "GET /monitor_schema": {"type": "object", "properties": {"f": {"type": "number"}}},
        "GET /execute_schema": {"type": "object", "properties": {"x": {"type": "number"}}},
        "GET /adaptation_options": {"x": {"start": -1.0, "stop": 1.0, "type": "continuous"}},
        "GET /adaptation_options_schema": {"type": "object", "properties": {"x": {"type": "object"}}},
    }

    def answer(connection: Any) -> None:
        name, _, body = read_request(connection)
        if name == "PUT /execute":
            changes.append(float(json.loads(body)["x"]))
            if len(changes) > lost:
                connection.sendall(response({"x": changes[-1]}))
        elif name == "GET /monitor":
            connection.sendall(response({"f": changes[-1] ** 2 if changes else 4.0}))
        else:
            connection.sendall(response(schemas[name]))

    return answer


def test_a_foreign_system_is_managed_by_a_dialect_of_ones_own() -> None:
    changes: Numbers = []
    with raw_server(demo_exemplar(changes)) as url, HttpSystem(UpisasClient(url, 10), DEMO) as system:
        assert system.reset().reward == -4
        assert [system.step(action).reward for action in (0, 0, 1)] == [-1, -1, 0]
    assert changes == [-1, -1, 0]


def test_a_foreign_system_that_may_have_acted_is_not_asked_again() -> None:
    changes: Numbers = []
    with raw_server(demo_exemplar(changes, lost=1)) as url, HttpSystem(UpisasClient(url, 10), DEMO) as system:
        system.reset()
        with pytest.raises(SystemFault, match="PUT /execute: Server disconnected") as caught:
            system.step(2)
        assert not caught.value.repeatable
    assert changes == [1]
