"""A guarded system behind HTTP whose server breaks in the middle of an episode, for good or for a while.

Whatever it does, a step ends in time: in the step itself, in the fallback, or in a fault that says what
has happened.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from merap.systems.interface import FaultKind, SystemFault
from merap.systems.retrying import Retries, RetryingSystem
from merap.systems.served_dialect import open_served
from tests.support.hand_made import grid_combination
from tests.support.http_servers import FlakyServer, raw_server, read_request, response, served_system

STOP, UP, DOWN, LEFT, RIGHT = range(5)
RETRIES = Retries(count=1, first_wait=0.01, longest_wait=0.01)
# What is waited for in vain is waited for briefly; what is answered has time enough on a busy machine.
BRIEFLY, LONG = 0.8, 30.0

Break = Callable[[socket.socket, str], None]


def hang(connection: socket.socket, _: str) -> None:
    connection.recv(1)


def hang_up(connection: socket.socket, _: str) -> None:
    connection.shutdown(socket.SHUT_RDWR)


def drip(connection: socket.socket, _: str) -> None:
    connection.sendall(b"HTTP/1.1 200 OK\r\ncontent-length: 100000\r\n\r\n")
    while True:
        connection.sendall(b" ")
        time.sleep(0.02)


def rubbish(connection: socket.socket, _: str) -> None:
    connection.sendall(bytes(range(256)) * 4 + b"\r\n\r\n")


def other_json(connection: socket.socket, _: str) -> None:
    connection.sendall(response([{"valuation": "none"}]))


def out_of_schema(connection: socket.socket, name: str) -> None:
    monitored = {"valuation": {"row": 99, "col": 0, "mode": 0}}
    connection.sendall(response(monitored if name == "GET /monitor" else {"action": "fly"}))


def fail(connection: socket.socket, _: str) -> None:
    connection.sendall(response({"error": "no power"}, "500 Internal Server Error"))


BREAKS: dict[str, tuple[Break, FaultKind]] = {
    "hangs": (hang, "timeout"),
    "hangs up": (hang_up, "dropped"),
    "drips": (drip, "timeout"),
    "answers rubbish": (rubbish, "malformed"),
    "answers other JSON": (other_json, "malformed"),
    "answers out of schema": (out_of_schema, "malformed"),
    "fails": (fail, "failed"),
}


class Breaking:
    """A sound server that breaks; `broken` tells how many requests still meet with that, -1: all."""

    def __init__(self, broken_by: Break) -> None:
        self.sound = FlakyServer(served_system(grid_combination(goal=(0, 2))), iter(()))
        self.broken_by = broken_by
        self.broken = 0
        self._lock = threading.Lock()

    def __call__(self, connection: socket.socket) -> None:
        name, _, body = read_request(connection)
        with self._lock:
            breaks = self.broken != 0
            self.broken -= self.broken > 0
        if breaks:
            self.broken_by(connection, name)
        else:
            connection.sendall(self.sound.answer(name, body))


@contextmanager
def begun(how: str, fallback: str) -> Iterator[tuple[RetryingSystem, Breaking]]:
    broken_by, kind = BREAKS[how]
    server = Breaking(broken_by)
    timeout = BRIEFLY if kind == "timeout" else LONG
    with raw_server(server) as url, open_served(url, timeout=timeout) as remote:
        system = RetryingSystem(remote, retries=RETRIES, fallback=fallback)
        system.reset()
        yield system, server


@pytest.mark.parametrize("how", BREAKS)
def test_a_server_that_breaks_for_good_ends_in_a_clear_fault(
    how: str, caplog: pytest.LogCaptureFixture
) -> None:
    _, kind = BREAKS[how]
    with begun(how, "stop") as (system, server):
        server.broken = -1
        began = time.monotonic()
        with caplog.at_level(logging.WARNING), pytest.raises(SystemFault) as caught:
            system.step(RIGHT)
        assert time.monotonic() - began < LONG  # three attempts, each of one request that is waited for
        assert caught.value.kind == kind
        assert "\n" not in str(caught.value)
        told = [record.getMessage() for record in caplog.records]
        assert len(told) == 2
        assert told[0].endswith("trying again in 0.01 s")
        assert told[1].endswith("falling back on stop")
        assert all(line.startswith(f"{kind}: http://127.0.0.1:") for line in told)
        assert server.sound.executed == 1  # the reset
        server.broken = 0
        assert system.reset().valuation.tolist() == [0, 0, 0]


@pytest.mark.parametrize("how", BREAKS)
@pytest.mark.parametrize("requests", [1, 2, 3])
def test_a_server_that_is_back_soon_is_managed_on(how: str, requests: int) -> None:
    """Broken for one request: mended by a retry. For two: the fallback. For three: a fault, then the step."""
    with begun(how, "stop") as (system, server):
        server.broken = requests
        if requests == 3:
            with pytest.raises(SystemFault):
                system.step(RIGHT)
        found = system.step(RIGHT)
        assert found.taken == (STOP if requests == 2 else None)
        assert found.valuation.tolist() == ([0, 0, 0] if requests == 2 else [0, 1, 0])
        assert server.sound.served.monitor()["step"] == 1
