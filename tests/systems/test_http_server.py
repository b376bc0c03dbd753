"""A real server on loopback, driven with plain httpx as the manager of another team would."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import httpx
import jsonschema
import numpy as np
import pytest

from merap.errors import InputError
from merap.families.loading import load_case
from merap.mapek.serving import served_combination
from merap.systems.http_server import MAX_BODY, listening, server
from tests.support.hand_made import at, cells, grid_combination, with_objective
from tests.support.http_servers import running, serving
from tests.support.paths import ROOT

RUNNING = "models/running-example"
SCHEMAS = ("/monitor_schema", "/adaptation_options_schema", "/execute_schema")
ENDPOINTS = ("/monitor", "/adaptation_options", *SCHEMAS)


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with serving(load_case(RUNNING).system("met"), detect=True) as url:
        yield url


@pytest.fixture
def client(url: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=url, trust_env=False, timeout=10) as client:
        client.put("/execute", json={"reset": True})
        yield client


def validate_as_upisas_does(body: dict[str, Any], schema: dict[str, Any]) -> None:
    """UPISAS wants `type` and `properties`, and the very keys of the properties in the body."""
    assert schema["type"] == "object"
    assert sorted(body) == sorted(schema["properties"])
    jsonschema.validate(body, schema)


def test_the_loop_of_a_upisas_manager(client: httpx.Client) -> None:
    """Ping, schemas, options, then monitor and execute until the episode is over, every body validated."""
    assert client.get("/").json()["system"] == "met"
    options_schema = client.get("/adaptation_options_schema").json()
    monitor_schema = client.get("/monitor_schema").json()
    execute_schema = client.get("/execute_schema").json()
    options = client.get("/adaptation_options").json()
    validate_as_upisas_does(options, options_schema)
    generator = np.random.default_rng(0)
    rewards = []
    monitored = client.get("/monitor").json()
    while not (monitored["truncated"] or monitored["continuation"] == 0):
        validate_as_upisas_does(monitored, monitor_schema)
        action = str(generator.choice(monitored["enabled"]))
        assert action in options["action"]["values"]
        done = client.put("/execute", json={"action": action})
        assert done.status_code == 200
        validate_as_upisas_does(done.json(), execute_schema)
        monitored = client.get("/monitor").json()
        rewards.append(monitored["reward"])
    assert monitored["step"] == len(rewards) == 40
    assert monitored["total"] == pytest.approx(sum(rewards))
    refused = client.put("/execute", json={"action": "stop"})
    assert refused.status_code == 409
    assert refused.json() == {"error": 'the episode is over; execute {"reset": true} first'}


def test_requests_that_the_client_of_upisas_lets_through_are_carried_out(client: httpx.Client) -> None:
    """It wants every key of the schema in a request too: the call of docs/online.md, beyond an episode."""
    schema = client.get("/execute_schema").json()
    monitored = client.get("/monitor").json()
    for _ in range(60):
        before = {"episode": monitored["episode"], "step": monitored["step"]}
        over = monitored["truncated"] or monitored["continuation"] == 0
        change = {"action": None if over else monitored["enabled"][0], "reset": over, **before}
        validate_as_upisas_does(change, schema)
        assert client.put("/execute", json=change).status_code == 200
        monitored = client.get("/monitor").json()
        after = (before["episode"] + 1, 0) if over else (before["episode"], before["step"] + 1)
        assert (monitored["episode"], monitored["step"]) == after
    page = (ROOT / "docs" / "online.md").read_text(encoding="utf-8")
    assert 'strategy.execute({"action": "east", "reset": False, **counters})' in page
    assert 'strategy.execute({"action": None, "reset": True, **counters})' in page


def test_it_is_driven_to_its_goal() -> None:
    """In the paper's grid with the goal at (0,2): two steps right and a stop there earn 10 - 0.5 * 2."""
    with serving(grid_combination(goal=(0, 2))) as url, httpx.Client(base_url=url, trust_env=False) as client:
        for action in ("right", "right", "stop"):
            client.put("/execute", json={"action": action})
        monitored = client.get("/monitor").json()
    assert monitored == {
        "valuation": {"row": 0, "col": 2, "mode": 0},
        "enabled": [],
        "reward": 10.0,
        "continuation": 0.0,
        "truncated": False,
        "detections": {},
        "action": "stop",
        "total": 9.0,
        "episode": 1,
        "step": 3,
    }


def test_looking_changes_nothing(client: httpx.Client) -> None:
    for endpoint in ENDPOINTS:
        first, second = client.get(endpoint), client.get(endpoint)
        assert first.status_code == 200
        assert first.content == second.content


def test_the_schemas_are_json_schemas(client: httpx.Client) -> None:
    for endpoint in SCHEMAS:
        jsonschema.Draft202012Validator.check_schema(client.get(endpoint).json())


def test_the_openapi_description_is_of_what_is_answered(client: httpx.Client) -> None:
    """Its paths are the endpoints, and what they answer is as it says."""
    paths = client.get("/openapi.json").json()["paths"]
    assert set(paths) == {*ENDPOINTS, "/execute"}
    for endpoint in ENDPOINTS:
        described = paths[endpoint]["get"]["responses"]["200"]["content"]["application/json"]["schema"]
        jsonschema.validate(client.get(endpoint).json(), described)
    responses = paths["/execute"]["put"]["responses"]
    for body, status in (({"action": "stop"}, 200), ({"action": "fly"}, 400), ({"action": "measure"}, 409)):
        answer = client.put("/execute", json=body)
        assert answer.status_code == status
        described = responses[str(status)]["content"]["application/json"]["schema"]
        jsonschema.validate(answer.json(), described)


@pytest.mark.parametrize(
    ("body", "status", "message"),
    [
        (b"", 400, "no JSON"),
        (b"\xff\xfe\x00", 400, "no JSON"),
        (b'{"action": ', 400, "no JSON"),
        (b"[" * 50_000, 400, "no JSON"),
        (b'{"episode": NaN, "step": 0, "reset": true}', 400, "NaN is no number"),
        (b"[]", 400, "is not of type 'object'"),
        (b"{}", 400, "give an action"),
        (b'{"action": "fly"}', 400, "'fly' is not one of"),
        (b'{"action": 0}', 400, "0 is not one of"),
        (b'{"action": "stop", "speed": 1}', 400, "'speed' was unexpected"),
        (b'{"action": "stop", "reset": true}', 400, "not both"),
        (b'{"action": "stop", "step": 0}', 400, "give episode and step"),
        (b'{"action": "stop", "episode": 0, "step": 0}', 400, "less than the minimum"),
        (b'{"action": "stop", "episode": "1", "step": 0}', 400, "is not of type 'integer'"),
        (b'{"action": "measure"}', 409, "not enabled now; enabled are stop"),
        (b'{"action": "stop", "episode": 1000000, "step": 0}', 409, "but the system is at episode"),
        (b'"' + b"x" * MAX_BODY + b'"', 413, "more than 65536 bytes"),
    ],
)
def test_a_bad_request_is_refused_in_one_line_and_nothing_happens(
    client: httpx.Client, body: bytes, status: int, message: str
) -> None:
    before = client.get("/monitor").content
    refused = client.put("/execute", content=body)
    assert refused.status_code == status
    assert list(refused.json()) == ["error"]
    assert message in refused.json()["error"]
    assert "\n" not in refused.json()["error"]
    assert len(refused.json()["error"]) < 600
    assert client.get("/monitor").content == before


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [("GET", "/nothing", 404), ("POST", "/execute", 405), ("GET", "/execute", 405), ("PUT", "/monitor", 405)],
)
def test_what_is_no_endpoint_names_those_that_are(
    client: httpx.Client, method: str, path: str, status: int
) -> None:
    refused = client.request(method, path)
    assert refused.status_code == status
    assert f"{method} {path}" in refused.json()["error"]
    assert "PUT /execute" in refused.json()["error"]


def test_a_request_with_counters_is_carried_out_once(client: httpx.Client) -> None:
    episode = client.get("/monitor").json()["episode"]
    request = {"action": "start_scan", "episode": episode, "step": 0}
    answers = [client.put("/execute", json=request).json() for _ in range(3)]
    assert answers == [{"action": "start_scan", "reset": False, "episode": episode, "step": 1}] * 3
    assert client.get("/monitor").json()["step"] == 1
    stale = client.put("/execute", json={**request, "action": "stop"})
    assert stale.status_code == 409
    begin = {"reset": True, "episode": episode, "step": 1}
    assert [client.put("/execute", json=begin).json()["episode"] for _ in range(3)] == [episode + 1] * 3


def test_a_client_that_hangs_up_amid_its_request_does_no_harm(url: str, client: httpx.Client) -> None:
    host, port = url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.sendall(b"PUT /execute HTTP/1.1\r\nhost: x\r\ncontent-length: 100\r\n\r\n{")
    with socket.create_connection((host, int(port))) as connection:
        connection.sendall(b"\x00\x01 rubbish\r\n\r\n")
        assert b"400" in connection.recv(4096)
    assert client.get("/monitor").status_code == 200


def test_a_port_that_is_taken_is_told_in_one_line() -> None:
    with listening("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(
            InputError, match=f"can't listen on port {port} of 127.0.0.1: Address already in use; choose"
        ):
            listening("127.0.0.1", port)


@pytest.mark.parametrize(
    ("host", "port", "message"),
    [
        ("127.0.0.1", 70_000, "from 0 to 65535, not 70000"),
        ("", 0, "an address to listen on can't be empty; 0.0.0.0 stands for all"),
        (" ", 0, "an address to listen on can't be empty"),
        ("127.0.0.1", -1, "from 0 to 65535, not -1"),
        ("203.0.113.7", 0, "Cannot assign requested address"),
    ],
)
def test_an_address_that_is_none_is_refused(host: str, port: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        listening(host, port)


def test_a_system_that_fails_itself_is_unavailable() -> None:
    """Where every task is complete in the goal and nothing resets the system, no task can begin there."""
    ending = at(cells((0, 1)))
    combination = with_objective(grid_combination(goal=(0, 1)), ends_after=None, ends_in=ending)
    served = served_combination(combination, np.random.default_rng(0), reset="none")
    with running(server(served)) as url, httpx.Client(base_url=url, trust_env=False) as client:
        assert client.put("/execute", json={"action": "right"}).status_code == 200
        failed = client.put("/execute", json={"reset": True})
        assert failed.status_code == 503
        assert failed.json()["error"].startswith("no task can begin in state (row=0, col=1")
        assert client.get("/monitor").json()["continuation"] == 0
