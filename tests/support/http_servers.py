"""Servers on loopback: a sound one, and raw ones that misbehave."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal

import numpy as np
import uvicorn

from merap.concerns.combination import Combination
from merap.systems.description import (
    adaptation_options,
    adaptation_options_schema,
    execute_schema,
    interface_of,
    monitor_schema,
)
from merap.systems.http_server import listening, server
from merap.systems.served import RefusedRequestError, ServedSystem
from merap.systems.simulated import SimulatedSystem

Connection = Callable[[socket.socket], None]


def served_system(combination: Combination, seed: int = 0, *, detect: bool = False) -> ServedSystem:
    simulated = SimulatedSystem(
        combination, combination.objective.horizon, np.random.default_rng(seed), detect=detect
    )
    return ServedSystem(simulated, interface_of(combination, detect=detect))


@contextmanager
def running(answering: uvicorn.Server) -> Iterator[str]:
    """Yield the URL of a server that runs in a thread until the end."""
    with listening("127.0.0.1", 0) as listener:
        thread = threading.Thread(target=answering.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            answering.should_exit = True
            thread.join()


@contextmanager
def serving(combination: Combination, seed: int = 0, *, detect: bool = False) -> Iterator[str]:
    with running(server(served_system(combination, seed, detect=detect))) as url:
        yield url


@contextmanager
def raw_server(answer: Connection) -> Iterator[str]:
    """Yield the URL of a server that hands every connection to `answer`, each in a thread of its own."""
    listener = socket.create_server(("127.0.0.1", 0))
    open_connections: list[socket.socket] = []

    def handle(connection: socket.socket) -> None:
        with connection:
            try:
                answer(connection)
            except OSError:
                return  # the client has hung up

    def accept() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            open_connections.append(connection)
            threading.Thread(target=handle, args=(connection,), daemon=True).start()

    thread = threading.Thread(target=accept)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join()
        for connection in open_connections:
            connection.close()


def read_request(connection: socket.socket) -> tuple[str, dict[bytes, bytes], bytes]:
    """One request whole: `GET /monitor`, its header in lower case and its body."""
    received = b""
    while b"\r\n\r\n" not in received:
        part = connection.recv(65_536)
        if not part:
            raise OSError("hung up")
        received += part
    head, _, body = received.partition(b"\r\n\r\n")
    fields = dict(line.lower().split(b": ", 1) for line in head.split(b"\r\n")[1:])
    while len(body) < int(fields.get(b"content-length", 0)):
        body += connection.recv(65_536)
    return " ".join(head.decode().split()[:2]), fields, body


def request_line(connection: socket.socket) -> str:
    """Reads one request whole; gives `GET /monitor`."""
    return read_request(connection)[0]


def response(content: Any, status: str = "200 OK") -> bytes:
    body = content if isinstance(content, bytes) else json.dumps(content).encode()
    head = f"HTTP/1.1 {status}\r\ncontent-type: application/json\r\ncontent-length: {len(body)}\r\n"
    return head.encode() + b"connection: close\r\n\r\n" + body


def free_port() -> int:
    """Return a port where nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


# What a flaky server does with a request: carries it out and answers, loses it, loses its answer, or fails.
Mishap = Literal["none", "lost", "answer lost", "failed", "rubbish"]


class FlakyServer:
    """A sound system behind a connection with mishaps; see `raw_server`.

    Args:
        served: the system.
        mishaps: one for each request; after the last there are none.
    """

    def __init__(self, served: ServedSystem, mishaps: Iterator[Mishap]) -> None:
        self.served = served
        self.mishaps = mishaps
        self.executed = 0
        self._lock = threading.Lock()

    def __call__(self, connection: socket.socket) -> None:
        name, _, body = read_request(connection)
        with self._lock:
            mishap = next(self.mishaps, "none")
            if mishap == "lost":
                return
            failed = mishap == "failed"
            answer = response({"error": "no power"}, "500 Oops") if failed else self.answer(name, body)
        if mishap != "answer lost":
            connection.sendall(b"rubbish\r\n\r\n" if mishap == "rubbish" else answer)

    def answer(self, name: str, body: bytes) -> bytes:
        """What the system answers, as bytes of HTTP."""
        interface = self.served.interface
        fixed = {
            "GET /monitor_schema": monitor_schema(interface),
            "GET /adaptation_options": adaptation_options(interface),
            "GET /adaptation_options_schema": adaptation_options_schema(interface),
            "GET /execute_schema": execute_schema(interface),
        }
        if name in fixed:
            return response(fixed[name])
        if name == "GET /monitor":
            return response(self.served.monitor())
        try:
            done = self.served.execute(json.loads(body))
        except RefusedRequestError as error:
            return response({"error": str(error)}, f"{error.status.value} Refused")
        self.executed += 1
        return response(done)
