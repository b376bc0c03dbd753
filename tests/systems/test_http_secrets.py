"""Credentials and tokens of a system's URL are used, and seen nowhere."""

from __future__ import annotations

import logging
import threading
from base64 import b64encode

import pytest

from merap.errors import InputError, MerapError
from merap.systems.http_client import UpisasClient
from merap.systems.interface import SystemFault
from merap.systems.served_dialect import open_served
from tests.support.guarded_server import GuardedServer
from tests.support.hand_made import grid_combination
from tests.support.http_servers import free_port, raw_server, served_system

# How a URL says it, what is to arrive as credentials and as query, and what nobody may see.
SAID = [
    ("robot:s3cret@", "robot:s3cret", "", ["s3cret"]),
    ("robot:s3%40cret%2F@", "robot:s3@cret/", "", ["s3@cret", "s3%40cret"]),
    ("robot:s3@cret@", "robot:s3@cret", "", ["s3@cret", "cret@"]),
    ("robot:s3/cret@", "robot:s3/cret", "", ["s3/cret", "s3%2Fcret"]),
    ("robot:s3?c#ret@", "robot:s3?c#ret", "", ["s3?c#ret", "c#ret"]),
    ("t0k-en@", "t0k-en:", "", ["t0k-en"]),
    (":s3cret@", ":s3cret", "", ["s3cret"]),
    ("", "", "token=t0k-en", ["t0k-en"]),
    ("", "", "a=1&key=t0k-en%20x", ["t0k-en", "t0k-en%20x"]),
    ("robot:s3cret@", "robot:s3cret", "sig=t0k-en", ["s3cret", "t0k-en"]),
]


def basic(credentials: str) -> str:
    return f"Basic {b64encode(credentials.encode()).decode()}" if credentials else ""


@pytest.mark.parametrize(("said", "credentials", "query", "secrets"), SAID)
def test_they_are_sent_with_every_request_and_nothing_shows_them(
    said: str, credentials: str, query: str, secrets: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    served = served_system(grid_combination(goal=(0, 2)))
    guarded = GuardedServer(served, authorization=basic(credentials), query=query)
    with raw_server(guarded) as bare:
        url = bare.replace("//", f"//{said}") + "/" + (f"?{query}" if query else "")
        with open_served(url, timeout=10) as system:
            names = [thread.name for thread in threading.enumerate()]
            system.reset()
            system.step(0)
            shown = [repr(system), repr(system.interface), *names]
            guarded.authorization = "others"
            with pytest.raises(SystemFault, match="status 401: not allowed: ") as refused:
                system.step(0)
            guarded.authorization, guarded.out_of_order = basic(credentials), 0
            with pytest.raises(SystemFault, match="status 500: no power") as failed:
                system.step(0)
    shown += [str(refused.value), repr(refused.value), str(failed.value), caplog.text]
    hidden = [*secrets, basic(credentials)[6:]] if credentials else secrets
    assert not [(secret, text) for text in shown for secret in hidden if secret in text]


@pytest.mark.parametrize(
    "url",
    [
        "http://robot:s3cret@127.0.0.1:{port}",
        "http://robot:s3@s3cret@127.0.0.1:{port}",
        "http://127.0.0.1:{port}?token=s3cret",
        "http://robot:s3cret@no-such-host.invalid",
        "http://robot:s3cret@host:notaport",
        "http://robot:s3cret@host:99999",
        "http://robot:s3cret@",
        "ftp://robot:s3cret@host",
        "//robot:s3cret@host",
        "robot:s3cret@host",
        "http:robot:s3cret@host",
        "http://robot:s3cret@ho st",
        "http://robot:s3cret@host\n",
        "http://robot:s3cret@[::1",
        "http://robot:s3cret@" + "a" * 70_000,
    ],
)
def test_an_address_that_is_wrong_is_told_in_one_line_without_them(url: str) -> None:
    with pytest.raises(MerapError) as error:
        UpisasClient(url.format(port=free_port()), 5).monitor()
    assert "s3cret" not in str(error.value)
    assert "s3cret" not in str(error.value.__cause__)
    assert "\n" not in str(error.value)


def test_a_system_of_another_case_is_named_without_them() -> None:
    with raw_server(
        GuardedServer(served_system(grid_combination()), authorization=basic("me:s3cret"))
    ) as url:
        with pytest.raises(InputError, match=r"http://\*\*\*@127.* has the actions") as error:
            open_served(url.replace("//", "//me:s3cret@"), actions=("fly",))
        assert "s3cret" not in str(error.value)
