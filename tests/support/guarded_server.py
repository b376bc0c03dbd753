"""A sound system behind a server that asks for credentials or a token, and repeats them in its errors."""

from __future__ import annotations

import socket

from merap.systems.served import ServedSystem
from tests.support.http_servers import FlakyServer, read_request, response


class GuardedServer:
    """Answers those who are allowed; see `raw_server`.

    Args:
        served: the system.
        authorization: the header that is asked for; empty: none.
        query: that is asked for; empty: none.
        out_of_order: from which request on it fails, and repeats what it was sent.
    """

    def __init__(
        self, served: ServedSystem, *, authorization: str = "", query: str = "", out_of_order: int = 10**9
    ) -> None:
        self.flaky = FlakyServer(served, iter(()))
        self.authorization, self.query, self.out_of_order = authorization, query, out_of_order
        self.requests = 0
        # As it was sent: the header is read in lower case.
        self.repeated = authorization

    def __call__(self, connection: socket.socket) -> None:
        line, fields, body = read_request(connection)
        name, _, query = line.partition("?")
        given = fields.get(b"authorization", b"").decode()
        self.requests += 1
        if given.lower() != self.authorization.lower() or query != self.query:
            connection.sendall(
                response({"error": f"not allowed: {self.repeated} ?{query}"}, "401 Unauthorized")
            )
        elif self.requests > self.out_of_order:
            connection.sendall(response({"error": f"no power for {self.repeated} ?{query}"}, "500 Oops"))
        else:
            connection.sendall(self.flaky.answer(name, body))
