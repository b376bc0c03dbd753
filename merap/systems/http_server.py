"""Serve a managed system by HTTP, with the endpoints of the UPISAS project.

A request that is refused is answered by `{"error": "one line"}` with a status of 4xx; a fault of the system
itself with 503.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Awaitable, Callable
from http import HTTPStatus

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse
from starlette.routing import Route

from merap.errors import InputError, MerapError
from merap.systems.description import (
    Json,
    adaptation_options,
    adaptation_options_schema,
    execute_schema,
    monitor_schema,
)
from merap.systems.http_rules import MAX_PORT, strict_json
from merap.systems.openapi import openapi
from merap.systems.served import RefusedRequestError, ServedSystem

ENDPOINTS = (
    "GET /monitor",
    "GET /monitor_schema",
    "GET /adaptation_options",
    "GET /adaptation_options_schema",
    "GET /execute_schema",
    "PUT /execute",
    "GET /openapi.json",
)
MAX_BODY = 64 * 1024
log = logging.getLogger(__name__)

Handler = Callable[[Request], Awaitable[JSONResponse]]


def application(served: ServedSystem) -> Starlette:
    """Build the ASGI application of a system."""
    interface = served.interface
    fixed = {
        "/monitor_schema": monitor_schema(interface),
        "/adaptation_options": adaptation_options(interface),
        "/adaptation_options_schema": adaptation_options_schema(interface),
        "/execute_schema": execute_schema(interface),
    }
    fixed["/openapi.json"] = openapi(interface)
    fixed["/"] = {"system": interface.system, "endpoints": list(ENDPOINTS)}

    async def monitor(_: Request) -> JSONResponse:
        return JSONResponse(served.monitor())

    async def execute(request: Request) -> JSONResponse:
        body = await _body(request)
        # The simulation is quick and nothing is awaited in it: requests are carried out one by one.
        done = served.execute(body)
        log.info("executed %s", done)
        return JSONResponse(done)

    return Starlette(
        routes=[
            *(Route(path, _answering(content), methods=["GET"]) for path, content in fixed.items()),
            Route("/monitor", monitor, methods=["GET"]),
            Route("/execute", execute, methods=["PUT"]),
        ],
        exception_handlers={
            RefusedRequestError: _refused,
            MerapError: _failed,
            HTTPException: _no_endpoint,
            ClientDisconnect: _gone,
        },
    )


def listening(host: str, port: int) -> socket.socket:
    """Open a socket that listens.

    Args:
        host: an address of this machine.
        port: 0 takes any that is free.

    Raises:
        InputError: the port is taken or forbidden, or there is no such address.
    """
    if not host.strip():
        raise InputError("an address to listen on can't be empty; 0.0.0.0 stands for all of this machine's")
    if not 0 <= port <= MAX_PORT:
        raise InputError(f"a port is a number from 0 to {MAX_PORT}, not {port}")
    try:
        listener = socket.create_server((host, port))
    except OSError as error:
        reason = str(error.strerror).partition(" (while")[0]
        raise InputError(f"can't listen on port {port} of {host}: {reason}; choose another") from error
    # Connections inherit it; without, each answer waits 40 ms for an acknowledgement that is delayed.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def server(served: ServedSystem) -> uvicorn.Server:
    """Build the server; its `run(sockets=[listener])` ends by SIGINT, SIGTERM or `should_exit`."""
    return uvicorn.Server(
        uvicorn.Config(
            application(served),
            log_config=None,
            access_log=False,
            lifespan="off",
            ws="none",
            timeout_graceful_shutdown=1,
        )
    )


async def _body(request: Request) -> object:
    received = bytearray()
    async for part in request.stream():
        received += part
        if len(received) > MAX_BODY:
            raise RefusedRequestError(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"the body has more than {MAX_BODY} bytes"
            )
    try:
        return strict_json(received)
    except (ValueError, RecursionError) as error:
        raise RefusedRequestError(HTTPStatus.BAD_REQUEST, f"the body is no JSON: {error}") from error


def _answering(content: Json) -> Handler:
    async def answer(_: Request) -> JSONResponse:
        return JSONResponse(content)

    return answer


async def _refused(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RefusedRequestError)
    log.warning("refused: %s", error)
    return JSONResponse({"error": str(error)}, error.status)


async def _failed(_: Request, error: Exception) -> JSONResponse:
    log.error("the system failed: %s", error)
    return JSONResponse({"error": str(error)}, HTTPStatus.SERVICE_UNAVAILABLE)


async def _gone(_: Request, error: Exception) -> JSONResponse:
    log.warning("the manager hung up amid its request")
    return JSONResponse({"error": "the request broke off"}, HTTPStatus.BAD_REQUEST)


async def _no_endpoint(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    message = f"{request.method} {request.url.path}: {error.detail}; there are {', '.join(ENDPOINTS)}"
    return JSONResponse({"error": message}, error.status_code, error.headers)
