"""Send requests to a managed system behind HTTP, each with an overall deadline.

The endpoints are those of the UPISAS project. What is answered is read up to a limit, as JSON, and checked
against the schema that the system serves for it. Proxies of the environment are not used.
"""

from __future__ import annotations

import asyncio
import json
import threading
from base64 import b64encode
from collections.abc import Coroutine, Mapping
from contextlib import AbstractContextManager
from http import HTTPStatus
from typing import Any, Self, TypeVar
from urllib.parse import unquote

import httpx
from jsonschema import Draft202012Validator
from jsonschema.exceptions import SchemaError
from referencing import Registry
from referencing.exceptions import Unresolvable

from merap.errors import InputError, shortened
from merap.masking import SplitUrl, masked, masked_url, secrets_in, split_url
from merap.systems.dialect import MAX_SHOWN, first_misfit
from merap.systems.http_rules import MAX_PORT, strict_json
from merap.systems.interface import FaultKind, SystemFault

Result = TypeVar("Result")

MAX_ANSWER = 16 * 1024 * 1024
# What httpx raises, the first that fits.
_KINDS: tuple[tuple[type[httpx.HTTPError], FaultKind], ...] = (
    (httpx.TimeoutException, "timeout"),
    (httpx.ConnectError, "refused"),
    (httpx.UnsupportedProtocol, "refused"),
    (httpx.RemoteProtocolError, "malformed"),
    (httpx.DecodingError, "malformed"),
    (httpx.HTTPError, "dropped"),
)


class EventLoopThread:
    """Run coroutines in a thread, so that plain calls can wait for what must be cancelled in time.

    If it is never stopped, it does not keep the process from ending. `name` is that of the thread.
    """

    def __init__(self, name: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=name, daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Wait for the result; what the work raises is raised here."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def stop(self) -> None:
        """End the thread; nothing can be run any more."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


class _SecretTransport(httpx.AsyncHTTPTransport):
    """Adds credentials and query to a request on its way: nothing that shows or logs it has them.

    Args:
        parts: parts of the system's URL.
    """

    def __init__(self, parts: SplitUrl) -> None:
        super().__init__(trust_env=False)
        self._query = httpx.URL(f"{parts.bare}?{parts.query}").query if parts.query else b""
        self._credentials = _basic(parts)

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        """Send a copy of the request that has them."""
        headers = request.headers.copy()
        if self._credentials:
            headers["authorization"] = f"Basic {self._credentials}"
        url = request.url.copy_with(query=self._query) if self._query else request.url
        complete = httpx.Request(
            request.method, url, headers=headers, stream=request.stream, extensions=request.extensions
        )
        return await super().handle_async_request(complete)


class UpisasClient(AbstractContextManager["UpisasClient"]):
    """Speaks to one system; to be closed, or used in a `with` statement.

    Attributes:
        url: where its endpoints are, as messages show it: without a password or token.

    Args:
        url: where its endpoints are, as `http://localhost:3000`; credentials in it are sent as
            basic authentication, its query with every request.
        timeout: seconds from the beginning of a request to the end of its answer.

    Raises:
        InputError: the URL or the time is none.
    """

    def __init__(self, url: str, timeout: float) -> None:
        if not timeout > 0:
            raise InputError(f"a timeout is a positive number of seconds, not {timeout}")
        parts = _checked(url)
        self.url = masked_url(url).rstrip("/")
        self._secrets = (*filter(None, [_basic(parts)]), *secrets_in(url))
        self._timeout = timeout
        self._closed = False
        self._validators: dict[str, Draft202012Validator] = {}
        self._client = httpx.AsyncClient(
            base_url=parts.bare,
            timeout=timeout,
            trust_env=False,
            transport=_SecretTransport(parts),
            headers={"accept-encoding": "identity"},
        )
        # Only in an event loop a request can be given up at any moment.
        self._thread = EventLoopThread(f"client of {self.url}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; nothing can be asked any more."""
        if self._closed:
            return
        self._closed = True
        self._thread.run(self._client.aclose())
        self._thread.stop()

    def get(self, endpoint: str) -> Any:
        """Get the JSON of an endpoint that has no schema, as a schema itself.

        Raises:
            SystemFault: there is no sound answer.
        """
        return self._json("GET", endpoint, None)

    def monitor(self) -> dict[str, Any]:
        """Ask what the system shows now.

        Raises:
            SystemFault: there is no sound answer.
        """
        return self._checked_by("monitor_schema", "GET /monitor", self.get("/monitor"))

    def adaptation_options(self) -> dict[str, Any]:
        """Ask what can be changed.

        Raises:
            SystemFault: there is no sound answer.
        """
        return self._checked_by(
            "adaptation_options_schema", "GET /adaptation_options", self.get("/adaptation_options")
        )

    def execute(self, change: Mapping[str, Any]) -> dict[str, Any]:
        """Change something.

        Raises:
            SystemFault: there is no sound answer; of kind `rejected` if nothing has been changed.
        """
        return self._checked_by("execute_schema", "PUT /execute", self._json("PUT", "/execute", change))

    def schema(self, name: str) -> dict[str, Any]:
        """Return a schema that the system serves; it is asked for once.

        Raises:
            SystemFault: there is none, or it is no JSON Schema.
        """
        schema = self._validator(name).schema
        assert isinstance(schema, dict)
        return schema

    def _validator(self, name: str) -> Draft202012Validator:
        if name not in self._validators:
            schema = self.get(f"/{name}")
            if not isinstance(schema, dict):
                raise self.fault("malformed", f"GET /{name}", f"a schema is an object, not {_shown(schema)}")
            try:
                Draft202012Validator.check_schema(schema)
            except SchemaError as error:
                raise self.fault("malformed", f"GET /{name}", f"no JSON Schema: {error.message}") from error
            # A registry of its own: by default a validator fetches what a schema refers to.
            self._validators[name] = Draft202012Validator(schema, registry=Registry())
        return self._validators[name]

    def _checked_by(self, schema: str, request: str, content: Any) -> dict[str, Any]:
        if not isinstance(content, dict):
            raise self.fault("malformed", request, f"expected an object, got {_shown(content)}")
        validator = self._validator(schema)
        try:
            misfit = first_misfit(validator, content)
        except (Unresolvable, RecursionError) as unusable:
            raise self.fault("malformed", f"GET /{schema}", f"an unusable schema: {unusable}") from unusable
        if misfit is not None:
            raise self.fault("malformed", request, f"not as {schema} says{misfit}")
        return content

    def _json(self, method: str, endpoint: str, content: Any) -> Any:
        if self._closed:
            raise InputError(f"the client of {self.url} is closed")
        request = f"{method} {endpoint}"
        status, body = self._thread.run(self._answer(method, endpoint, content))
        if not HTTPStatus(200) <= status < HTTPStatus(300):
            raise self.fault(_kind_of_status(status), request, f"status {status}: {_message(body)}")
        try:
            return strict_json(body)
        except (ValueError, RecursionError) as error:
            raise self.fault("malformed", request, f"no JSON but {_shown(body)}") from error

    async def _answer(self, method: str, endpoint: str, content: Any) -> tuple[int, bytes]:
        request = f"{method} {endpoint}"
        try:
            async with (
                asyncio.timeout(self._timeout),
                self._client.stream(method, endpoint, json=content) as response,
            ):
                return response.status_code, await self._whole(request, response)
        except TimeoutError as error:
            raise self.fault("timeout", request, f"no whole answer within {self._timeout:g} s") from error
        except httpx.HTTPError as error:
            raise self.fault(_kind(error), request, str(error) or type(error).__name__) from error

    async def _whole(self, request: str, response: httpx.Response) -> bytes:
        received = bytearray()
        async for part in response.aiter_bytes():
            received += part
            if len(received) > MAX_ANSWER:
                raise self.fault("malformed", request, f"an answer of more than {MAX_ANSWER} bytes")
        return bytes(received)

    def fault(self, kind: FaultKind, request: str, message: str) -> SystemFault:
        """Build a fault of a request; the server may have repeated the secrets that it was sent."""
        shown = masked(message, self._secrets)
        return SystemFault(kind, f"{self.url}: {request}: {shown}", repeatable=kind != "rejected")


def _checked(url: str) -> SplitUrl:
    parts = split_url(url)
    try:
        parsed = httpx.URL("" if parts is None else parts.bare)
        port = parsed.port or 0
    except httpx.InvalidURL as error:
        raise InputError(f"{masked_url(url)!r} is no URL: {masked(str(error), secrets_in(url))}") from error
    if parts is None or parts.scheme not in {"http", "https"} or not parsed.host or port > MAX_PORT:
        raise InputError(f"{masked_url(url)!r} is no URL of HTTP, as http://localhost:3000 is one")
    return parts


def _basic(parts: SplitUrl) -> str:
    """Return the credentials of a URL as basic authentication has them (RFC 7617)."""
    if parts.user is None:
        return ""
    return b64encode(f"{unquote(parts.user)}:{unquote(parts.password or '')}".encode()).decode()


def _kind(error: httpx.HTTPError) -> FaultKind:
    # One class of httpx stands for a broken protocol and for a connection that was closed too early.
    if isinstance(error, httpx.RemoteProtocolError) and "without sending" in str(error):
        return "dropped"
    return next(kind for raised, kind in _KINDS if isinstance(error, raised))


def _kind_of_status(status: int) -> FaultKind:
    if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        return "failed"
    return "rejected" if status >= HTTPStatus.BAD_REQUEST else "malformed"


def _message(body: bytes) -> str:
    """Return the server's own words, if they have the form that ours have."""
    try:
        content = json.loads(body)
    except (ValueError, RecursionError):
        return _shown(body)
    error = content.get("error") if isinstance(content, dict) else None
    return error if isinstance(error, str) else _shown(body)


def _shown(content: Any) -> str:
    return shortened(repr(content), MAX_SHOWN)
