"""Systems that hang, hang up, or answer rubbish: each ends in a fault that says so, in time."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from typing import Any

import pytest

from merap.errors import InputError
from merap.systems import http_client
from merap.systems.http_client import UpisasClient
from merap.systems.interface import FaultKind, SystemFault
from tests.support.hand_made import grid_combination
from tests.support.http_servers import (
    Connection,
    free_port,
    raw_server,
    read_request,
    request_line,
    response,
    serving,
)

TIMEOUT = 0.5
SOUND = {
    "GET /monitor_schema": {"type": "object", "properties": {"f": {"type": "number"}}, "required": ["f"]},
    "GET /execute_schema": {"type": "object", "properties": {"x": {"type": "number"}}},
    "GET /adaptation_options_schema": {"type": "object", "properties": {"x": {"type": "object"}}},
    "GET /adaptation_options": {"x": {"start": -4.0, "stop": 6.0}},
    "GET /monitor": {"f": 0.25},
    "PUT /execute": {"x": 1.0},
}


def answering(**changes: Any) -> Connection:
    """A sound server but for some endpoints; bytes are sent as they are."""
    answers = {**SOUND, **{key.replace("_to_", " /"): value for key, value in changes.items()}}

    def answer(connection: socket.socket) -> None:
        content = answers[request_line(connection)]
        connection.sendall(content if isinstance(content, bytes) else response(content))

    return answer


def monitor_bytes(content: bytes) -> Connection:
    return answering(GET_to_monitor=content)


def hanging(connection: socket.socket) -> None:
    request_line(connection)
    connection.recv(1)


def hanging_up(connection: socket.socket) -> None:
    request_line(connection)


def dripping(prefix: bytes) -> Connection:
    """Sends one byte every 50 ms after the prefix: no single read is ever late."""

    def answer(connection: socket.socket) -> None:
        request_line(connection)
        connection.sendall(prefix)
        while True:
            connection.sendall(b"a")
            time.sleep(0.05)

    return answer


def endless(connection: socket.socket) -> None:
    request_line(connection)
    connection.sendall(b"HTTP/1.1 200 OK\r\n\r\n")
    while True:
        connection.sendall(b" " * 65_536)


HEAD = b"HTTP/1.1 200 OK\r\ncontent-type: application/json\r\ncontent-length: 1000\r\n"


@pytest.mark.parametrize(
    ("answer", "kind", "message"),
    [
        (hanging, "timeout", "no whole answer within 0.5 s"),
        (dripping(b""), "timeout", "no whole answer within 0.5 s"),
        (dripping(b"HTTP/1.1 200 OK\r\nx: "), "timeout", "no whole answer within 0.5 s"),
        (dripping(HEAD + b"\r\n"), "timeout", "no whole answer within 0.5 s"),
        (hanging_up, "dropped", "without sending a response"),
        (monitor_bytes(HEAD + b'\r\n{"f": 0.'), "dropped", "without sending complete message body"),
        (monitor_bytes(b"\x00\xff rubbish \x17" * 20), "malformed", "illegal request line"),
        (monitor_bytes(HEAD + b"content-encoding: gzip\r\n\r\n" + b"x" * 99), "malformed", "incorrect"),
        (monitor_bytes(response(b"\xff\xfe{]")), "malformed", r"no JSON but b'\\xff\\xfe{]'"),
        (monitor_bytes(response(b"")), "malformed", "no JSON but b''"),
        (monitor_bytes(response(b"[" * 100_000)), "malformed", "no JSON but"),
        (monitor_bytes(response(b'{"f": NaN}')), "malformed", "no JSON but"),
        (monitor_bytes(response(b"<html>a proxy</html>")), "malformed", "<html>"),
        (answering(GET_to_monitor=[1, 2]), "malformed", r"expected an object, got \[1, 2\]"),
        (answering(GET_to_monitor={"f": "high"}), "malformed", "not as monitor_schema says at 'f': 'high'"),
        (answering(GET_to_monitor={}), "malformed", "'f' is a required property"),
        (answering(GET_to_monitor_schema=[]), "malformed", r"a schema is an object, not \[\]"),
        (answering(GET_to_monitor_schema={"type": "thing"}), "malformed", "no JSON Schema"),
        (answering(GET_to_monitor_schema={"$ref": "http://127.0.0.1"}), "malformed", "an unusable schema"),
        (answering(GET_to_monitor_schema={"$ref": "#"}), "malformed", "an unusable schema"),
        (answering(GET_to_monitor_schema={"pattern": "("}), "malformed", "no JSON Schema"),
        (monitor_bytes(response(b"oops", "500 Internal Server Error")), "failed", "status 500: b'oops'"),
        (monitor_bytes(response({"error": "no power"}, "503 Unavailable")), "failed", "status 503: no power"),
        (monitor_bytes(response({"error": "not now"}, "409 Conflict")), "rejected", "status 409: not now"),
        (monitor_bytes(response(b"", "302 Found\r\nlocation: /")), "malformed", "status 302"),
    ],
)  # fmt: skip
def test_a_system_that_misbehaves(answer: Connection, kind: FaultKind, message: str) -> None:
    with raw_server(answer) as url, UpisasClient(url, TIMEOUT) as client:
        begun = time.monotonic()
        with pytest.raises(SystemFault, match=message) as caught:
            client.monitor()
        assert time.monotonic() - begun < 10 * TIMEOUT  # in time, however busy the machine is
    assert caught.value.kind == kind
    assert caught.value.repeatable == (kind != "rejected")
    assert caught.value.exit_code == 3
    line = str(caught.value)
    assert line.startswith(f"{kind}: {url}: GET /monitor")
    assert "\n" not in line
    assert len(line) < 600


def test_an_answer_without_end_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_client, "MAX_ANSWER", 1_000_000)
    with (
        raw_server(endless) as url,
        UpisasClient(url, 30) as client,
        pytest.raises(SystemFault, match="an answer of more than 1000000 bytes"),
    ):
        client.monitor()


def test_nobody_listens() -> None:
    with (
        UpisasClient(f"http://127.0.0.1:{free_port()}", TIMEOUT) as client,
        pytest.raises(SystemFault, match="GET /monitor: All connection attempts failed") as caught,
    ):
        client.monitor()
    assert caught.value.kind == "refused"


def test_a_connection_that_is_reset_amid_the_answer() -> None:
    def resetting(connection: socket.socket) -> None:
        request_line(connection)
        connection.sendall(HEAD + b'\r\n{"f"')
        # a close with lingering time 0 resets the connection
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")

    with (
        raw_server(resetting) as url,
        UpisasClient(url, TIMEOUT) as client,
        pytest.raises(SystemFault) as caught,
    ):
        client.monitor()
    assert caught.value.kind == "dropped"


def test_after_a_fault_the_next_request_is_a_fresh_one() -> None:
    faults: list[Callable[[socket.socket], None]] = [hanging, hanging_up, monitor_bytes(b"rubbish"), hanging]

    def mending(connection: socket.socket) -> None:
        (faults.pop() if faults else answering())(connection)

    with raw_server(mending) as url, UpisasClient(url, TIMEOUT) as client:
        while faults:
            with pytest.raises(SystemFault):
                client.monitor()
        assert client.monitor() == {"f": 0.25}


def test_a_sound_system() -> None:
    """A body of UPISAS' demo exemplar, as text of another content type."""
    with raw_server(answering()) as url, UpisasClient(url + "/", TIMEOUT) as client:
        assert client.adaptation_options() == SOUND["GET /adaptation_options"]
        assert client.execute({"x": 1.0}) == {"x": 1.0}
        assert client.monitor() == {"f": 0.25}
        assert client.schema("monitor_schema") == SOUND["GET /monitor_schema"]


def test_a_request_is_sent_as_json() -> None:
    received: list[tuple[bytes, bytes]] = []

    def recording(connection: socket.socket) -> None:
        name, header, body = read_request(connection)
        received.append((header.get(b"content-type", b""), body))
        connection.sendall(response(SOUND[name]))

    with raw_server(recording) as url, UpisasClient(url, 5) as client:
        client.execute({"x": 1.0})
    kind, body = received[0]
    assert kind == b"application/json"
    assert json.loads(body) == {"x": 1.0}


def test_a_client_that_is_closed_asks_nothing() -> None:
    client = UpisasClient(f"http://127.0.0.1:{free_port()}", 1)
    client.close()
    client.close()
    with pytest.raises(InputError, match="is closed"):
        client.monitor()


def test_each_schema_is_asked_for_once() -> None:
    asked: list[str] = []

    def counting(connection: socket.socket) -> None:
        name = request_line(connection)
        asked.append(name)
        connection.sendall(response(SOUND[name]))

    with raw_server(counting) as url, UpisasClient(url, 5) as client:
        for _ in range(3):
            client.monitor()
    assert asked.count("GET /monitor_schema") == 1
    assert asked.count("GET /monitor") == 3


@pytest.mark.parametrize(
    "url", ["", "127.0.0.1:3000", "ftp://x", "http://", "http://x:y", "http://x:99999999"]
)
def test_what_is_no_url_is_refused(url: str) -> None:
    with pytest.raises(InputError, match="is no URL"):
        UpisasClient(url, 1)


@pytest.mark.parametrize("timeout", [0, -1, float("nan")])
def test_what_is_no_time_is_refused(timeout: float) -> None:
    with pytest.raises(InputError, match="a timeout is a positive number"):
        UpisasClient("http://127.0.0.1:1", timeout)


def test_our_own_server_answers_as_its_schemas_say() -> None:
    with serving(grid_combination()) as url, UpisasClient(url, 10) as client:
        assert client.monitor()["valuation"] == {"row": 0, "col": 0, "mode": 0}
        assert client.execute({"action": "down"})["step"] == 1
        assert client.adaptation_options()["action"]["values"] == ["stop", "up", "down", "left", "right"]
