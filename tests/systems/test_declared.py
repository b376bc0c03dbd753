"""What a system shows is what it has declared, or a fault: where it is served, and where it is managed."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from merap.mapek.run import run_loop
from merap.systems.description import Interface, Json, ShownVariable, monitor_schema, require_declared
from merap.systems.http_server import server
from merap.systems.interface import Observation, SystemFault
from merap.systems.served import ServedSystem
from merap.systems.served_dialect import open_served
from tests.support.hand_made import grid_combination
from tests.support.http_servers import FlakyServer, raw_server, read_request, response, running, served_system
from tests.support.loop_runs import scenario
from tests.support.trained_runs import SMALL, trained

SHOWN = Interface("it", ("stop", "go"), (ShownVariable("row", -1, 3), ShownVariable("col", -1, 3)))
SOUND = Observation(np.array([1, 3]), np.array([True, False]), -0.5, 1.0, False)

UNDECLARED: dict[str, tuple[dict[str, Any], str]] = {
    "too high": ({"valuation": np.array([1, 4])}, "shows col 4, expected -1 to 3"),
    "too low": ({"valuation": np.array([-2, 0])}, "shows row -2, expected -1 to 3"),
    "half": ({"valuation": np.array([1, 1.5])}, "expected 2 whole numbers"),
    "real": ({"valuation": np.array([1.0, 2.0])}, "expected 2 whole numbers"),
    "text": ({"valuation": np.array(["1", "2"])}, "expected 2 whole numbers"),
    "one less": ({"valuation": np.array([1])}, "expected 2 whole numbers"),
    "deep": ({"valuation": np.array([[1, 2]])}, "expected 2 whole numbers"),
    "none": ({"valuation": None}, "expected 2 whole numbers"),
    "enabled numbers": ({"enabled": np.array([1, 0])}, "expected true or false for each of 2 actions"),
    "enabled too many": ({"enabled": np.array([True] * 3)}, "expected true or false for each of 2 actions"),
    "reward in an array": ({"reward": np.array([1.0])}, "expected a finite number"),
    "no reward": ({"reward": None}, "expected a finite number"),
    "reward not a number": ({"reward": float("nan")}, "expected a finite number"),
    "infinite reward": ({"reward": float("inf")}, "expected a finite number"),
    "continuation": ({"continuation": 1.5}, "expected a number from 0 to 1"),
    "truncated": ({"truncated": 1}, "expected true or false"),
}


class Showing:
    """Shows one thing after a reset and another one after each step."""

    actions = SHOWN.actions

    def __init__(self, first: Observation, later: Observation) -> None:
        self.first, self.later = first, later

    def reset(self) -> Observation:
        return self.first

    def step(self, action: int) -> Observation:
        return self.later


def test_what_is_declared_is_let_through() -> None:
    rewards: list[Any] = [1, -0.5, np.float32(2), np.int64(3)]
    for reward in rewards:
        require_declared(replace(SOUND, reward=reward), SHOWN)


@pytest.mark.parametrize("name", UNDECLARED)
def test_a_served_system_that_shows_what_is_not_declared_has_failed(name: str) -> None:
    change, message = UNDECLARED[name]
    wrong = replace(SOUND, **change)
    with pytest.raises(SystemFault, match=message):
        ServedSystem(Showing(wrong, SOUND), SHOWN)
    served = ServedSystem(Showing(SOUND, wrong), SHOWN)
    before = served.monitor()
    with running(server(served)) as url:
        answer = httpx.put(f"{url}/execute", json={"action": "stop"})
        assert answer.status_code == 503
        assert message in answer.json()["error"]
        assert httpx.get(f"{url}/monitor").json() == before


def exemplar(change: Callable[[Json], object]) -> Callable[[socket.socket], None]:
    """A sound system behind HTTP, which serves a schema that allows everything, and changes what it shows."""
    served = served_system(grid_combination())
    flaky = FlakyServer(served, iter(()))
    schema = deepcopy(monitor_schema(served.interface))
    for entry in (*schema["properties"]["valuation"]["properties"].values(), *schema["properties"].values()):
        entry.pop("type", None)
        entry.pop("enum", None)
    del schema["properties"]["enabled"]["items"]

    def answer(connection: socket.socket) -> None:
        name, _, body = read_request(connection)
        sent = flaky.answer(name, body)
        if name == "GET /monitor_schema":
            sent = response(schema)
        if name == "GET /monitor":
            shown = served.monitor()
            change(shown)
            sent = response(json.dumps(shown).replace('"1e999"', "1e999").encode())
        connection.sendall(sent)

    return answer


def shows(**values: object) -> Callable[[Json], object]:
    def change(shown: Json) -> None:
        shown["valuation"].update(
            {name: value for name, value in values.items() if name in shown["valuation"]}
        )
        shown.update({name: value for name, value in values.items() if name not in shown["valuation"]})

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (shows(row=9), "9"),
        (shows(row=-2), "-2"),
        (shows(row=1.5), "1.5"),
        (shows(row="1"), "'1'"),
        (shows(row=True), "True"),
        (shows(row=None), "None"),
        (shows(reward="1"), "'1'"),
        (shows(reward=[1.0]), r"\[1.0\]"),
        (shows(reward="1e999"), "inf"),
        (shows(continuation=2), "2"),
        (shows(truncated="false"), "'false'"),
        (shows(truncated=0), "0"),
        (shows(step=1.5), "1.5"),
        (shows(episode="1"), "'1'"),
        (shows(enabled=["fly"]), "'fly'"),
        (shows(enabled="stop"), "'stop'"),
        (shows(action="fly"), "fly"),
        (shows(detections=[]), r"\[\]"),
        (lambda shown: shown.pop("total"), "total"),
        (lambda shown: shown["valuation"].pop("row"), "row"),
    ],
)
def test_a_managed_system_that_shows_what_it_can_not_is_a_fault_whatever_its_schema_allows(
    change: Callable[[Json], object], message: str
) -> None:
    with raw_server(exemplar(change)) as url, open_served(url, timeout=10) as system:
        with pytest.raises(SystemFault, match=message) as error:
            system.reset()
        assert error.value.kind == "malformed"
        assert "\n" not in str(error.value)


def test_a_run_goes_on_after_a_value_out_of_range(tmp_path: Path) -> None:
    """One value out of range is asked for again; after three in a row the fallback is taken."""
    run = trained(tmp_path / "run", SMALL)
    server = FlakyServer(served_system(run.case.system("met")), iter(()))
    asked = iter(range(1000))

    def answer(connection: socket.socket) -> None:
        name, _, body = read_request(connection)
        sent = server.answer(name, body)
        if name == "GET /monitor" and next(asked) in {5, 8, 9, 10}:
            shown = server.served.monitor()
            shown["valuation"]["row"] = 9
            sent = response(shown)
        connection.sendall(sent)

    with raw_server(answer) as url:
        text = f"scenario: far\nsystem: {{url: '{url}', retries: 2}}\nepisodes: 2\n"
        report = run_loop(
            run, scenario(tmp_path, text, "strategy: {name: retrieval}\ndeadline: {fallback: stop}\n")
        )
    assert report.ended_by is None
    assert [row.episode for row in report.rows] == [0, 1]
    assert report.rows[0].faults == {"malformed": 4}
    assert (report.rows[0].problems, report.rows[0].fallbacks) == (1, 1)
