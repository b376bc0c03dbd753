"""A password of a knowledge base is used, and seen nowhere."""

from __future__ import annotations

import logging
from pathlib import Path
from urllib.parse import quote

import pytest

from merap.errors import InputError, MerapError
from merap.knowledge.base import open_knowledge
from merap.knowledge.engine import make_engine, read_url, url_of
from tests.support.command_line import merap
from tests.support.postgresql_server import role_with_password

# Each is a password of its own, with what a URL does not let stand unquoted.
PASSWORDS = ["s3cret", "hun@ter2", "p@sh4k@w0rd7", "sla/sh3d", "que?stion", "h#shed7", "a:b%c d"]
UNQUOTED = ["s3cret", "hun@ter2", "p@sh4k@w0rd7", "sla/sh3d", "que?stion", "h#shed7"]
UNREACHABLE = "127.0.0.1:1"


@pytest.fixture(params=PASSWORDS)
def role(request: pytest.FixtureRequest, postgresql_url: str) -> tuple[str, str]:
    """A password, and where its role `robot` may connect: `127.0.0.1:5432/postgres`."""
    password = str(request.param)
    return password, role_with_password(postgresql_url, password)


def urls(password: str, place: str) -> list[str]:
    """All ways to say the password."""
    host, _, database = place.partition("/")
    name, port = host.split(":")
    quoted = quote(password, safe="")
    found = [
        f"postgresql://robot:{quoted}@{place}",
        f"postgresql+psycopg://robot:{quoted}@{place}?application_name=merap",
        f"postgresql://robot@{place}?password={quoted}",
        f"postgresql:///{database}?host={name}&port={port}&user=robot&password={quoted}",
        f"postgresql://robot:{quoted}@{place}?sslmode=disable&sslpassword={quoted}",
    ]
    return [*found, f"postgresql://robot:{password}@{place}"] if password in UNQUOTED else found


def forms(password: str) -> set[str]:
    """The password as it may be shown, in parts too: a URL may be cut at an `@`."""
    return {form for form in (password, quote(password, safe=""), *password.split("@")) if len(form) > 3}


def test_every_way_to_say_a_password_connects_and_none_shows_it(
    role: tuple[str, str], caplog: pytest.LogCaptureFixture
) -> None:
    password, place = role
    with caplog.at_level(logging.DEBUG):
        for url in urls(password, place):
            with open_knowledge(url) as knowledge:
                run = knowledge.start_run("first", "case", "digest", {})
                assert knowledge.run(run).name == "first"
                shown = [
                    knowledge.place,
                    repr(knowledge),
                    repr(read_url(url)),
                    repr(make_engine(read_url(url))),
                ]
            assert not [text for text in shown for form in forms(password) if form in text]
    assert not [form for form in forms(password) if form in caplog.text]


@pytest.mark.parametrize("password", PASSWORDS)
def test_what_can_not_be_reached_is_told_without_the_password(password: str, tmp_path: Path) -> None:
    for url in [*urls(password, f"{UNREACHABLE}/x"), *urls(password, "no-such-host.invalid:5432/x")]:
        for verb in (["list"], ["show", 1], ["replay", 1], ["export", 1, "-o", tmp_path / "out"]):
            done = merap("knowledge", *verb, "--db", url)
            assert done.returncode == 3
            assert len(done.stderr.strip().splitlines()) == 1
            assert not [form for form in forms(password) if form in done.stdout + done.stderr]


@pytest.mark.parametrize(
    "url",
    [
        "postgresql://me:s3cret@host:notaport/x",
        "postgresql://me:s3cret@host/x?connect_timeout=soon",
        "postgresql://me@127.0.0.1:1/x?pasword=s3cret",
        "postgresql://me:a@s3cret/b@127.0.0.1:1/x",
        "postgres://me:s3cret@host/x",
        "mysql://me:s3cret@host/x?password=s3cret",
        "sqlite:///x.db?password=s3cret",
        "sqlite://me:s3cret@host/x.db",
        "nothing+at+all://me:s3cret@host/x",
        "://me:s3cret@host",
        "postgresql:me:s3cret@host/x",
        "postgresql:/me:s3cret@host/x",
        "me:s3cret@host/x",
        "host=127.0.0.1 user=me password=s3cret dbname=x",
        "host=127.0.0.1 password = 's3cret too' user=me",
        "postgresql://me:s3cret@" + "a" * 300 + "/x",
        "postgresql://me:s3cret@host\\x/\0",
        "postgresql:///x?host=a&host=b&port=1&port=z&user=me&password=s3cret",
        "postgresql:///x?host=127.0.0.1:1&host=127.0.0.1:z&user=me&password=s3cret",
    ],
)
def test_a_url_that_is_wrong_is_told_in_one_line_without_its_password(url: str) -> None:
    with pytest.raises(MerapError) as error:
        open_knowledge(url_of(url))
    assert "s3cret" not in str(error.value)
    assert "\n" not in str(error.value)
    assert "s3cret" not in str(error.value.__cause__)


def test_a_connection_string_is_no_name_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"password=\*\*\*.* is a connection string; expected a folder"):
        url_of("user=me password=s3cret")
    assert [*tmp_path.iterdir()] == []
