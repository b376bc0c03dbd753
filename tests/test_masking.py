"""Secrets of URLs, connection strings and JSON-like data, by hand-written cases."""

from __future__ import annotations

import pytest

from merap.errors import EngineError, InputError, MerapError
from merap.masking import masked, masked_data, masked_url, secrets_in, split_url
from merap.systems.interface import SystemFault

SHOWN = [
    ("http://localhost:3000", "http://localhost:3000"),
    ("http://user:s3cret@host:3000/base", "http://***@host:3000/base"),
    ("http://t0ken@host", "http://***@host"),
    ("http://t0ken:x-oauth-basic@host", "http://***@host"),
    ("http://user:p@s3cret@host:3000/base", "http://***@host:3000/base"),
    ("http://user:p/s3cret@host", "http://***@host"),
    ("http://host:3000/a@b", "http://host:3000/a@b"),
    ("http://host/x?token=s3cret&n=1&s3cret", "http://host/x?token=***&n=***&***"),
    ("http://host?a=x@s3cret", "http://host?a=***"),
    ("HTTPS://user:s3cret@host", "https://***@host"),
    ("http://host/#s3cret", "http://host/"),
    ("postgresql://me@host/x", "postgresql://me@host/x"),
    ("postgresql://me:s3cret@host:5432/x", "postgresql://me:***@host:5432/x"),
    ("postgresql://me:p@s3cret@host/x", "postgresql://me:***@host/x"),
    ("postgresql://me:12/s3cret@host/x", "postgresql://me:***@host/x"),
    ("postgresql://me:p?s3cret@host/x", "postgresql://me:***@host/x"),
    ("postgresql://me:p#s3cret@host/x", "postgresql://me:***@host/x"),
    ("postgresql://me:p s3cret@host/x", "postgresql://me:***@host/x"),
    ("postgresql://me:p@s3/cret@host/x", "postgresql://me:***@***"),
    ("postgresql:///x?host=h&user=a@b&password=s3cret", "postgresql:///x?host=***&user=***&password=***"),
    ("postgresql+psycopg://me:s3cret@[::1]:5/x", "postgresql+psycopg://me:***@[::1]:5/x"),
    ("sqlite:///folder@home/k.db", "sqlite:///folder@home/k.db"),
    ("mysql://:s3cret@host", "mysql://***@host"),
    ("me:s3cret@host/x", "me:***@host/x"),
    ("host=h password=s3cret user=me", "host=h password=*** user=me"),
    ("sslpassword = 's3cret \\' s3cret' user=me", "sslpassword = *** user=me"),
    ("no URL at all: a@b, 12:30", "no URL at all: a@b, 12:30"),
]


@pytest.mark.parametrize(("url", "shown"), SHOWN)
def test_a_url_is_shown_without_its_secrets(url: str, shown: str) -> None:
    assert masked_url(url) == shown
    assert masked_url(shown) == shown


@pytest.mark.parametrize(("url", "shown"), [pair for pair in SHOWN if " " not in pair[0]])
def test_a_url_in_a_text_is_shown_so_too(url: str, shown: str) -> None:
    for text in ("{}: GET /monitor: late", "can't open '{}'; try again", "({})", "{}, {}"):
        assert masked(text.replace("{}", url)) == text.replace("{}", shown)


@pytest.mark.parametrize(
    ("url", "bare", "user", "password"),
    [
        ("http://u:p@s@h:1/b?q=1", "http://h:1/b", "u", "p@s"),
        ("http://h:1/a@b", "http://h:1/a@b", None, None),
        ("http://tok@h", "http://h", "tok", None),
        ("postgresql://u:p/q@h/x", "postgresql://h/x", "u", "p/q"),
        ("postgresql://h:5/x?a=b@c", "postgresql://h:5/x", None, None),
    ],
)
def test_a_url_is_split_at_the_last_at_that_can_belong_to_its_credentials(
    url: str, bare: str, user: str | None, password: str | None
) -> None:
    parts = split_url(url)
    assert parts is not None
    assert (parts.bare, parts.user, parts.password) == (bare, user, password)
    assert "'q=1'" not in repr(parts)


def test_what_a_driver_may_repeat_is_known_in_every_form() -> None:
    assert set(secrets_in("postgresql://me:p%40ss%2Fw@h/x?sslmode=require&sslpassword=k3y k")) >= {
        "p@ss/w",
        "p%40ss%2Fw",
        "k3y k",
        "k3y%20k",
        "k3y+k",
    }
    assert masked("the option p@ss/w is bad", secrets_in("http://me:p%40ss%2Fw@h")) == "the option *** is bad"
    assert secrets_in("http://localhost:3000") == ()
    assert secrets_in({"api_key": "abcd", "n": [{"url": "http://h?sig=efgh"}], "name": "lake"}) == (
        "abcd",
        "efgh",
    )


def test_data_is_stored_without_secrets() -> None:
    given = {
        "api_key": "s3cret",
        "password": 1234,
        "n": 3,
        "at": ["http://u:s3cret@h", {"accessToken": ["s3cret"]}],
    }
    assert masked_data(given) == {
        "api_key": "***",
        "password": "***",
        "n": 3,
        "at": ["http://***@h", {"accessToken": "***"}],
    }


@pytest.mark.parametrize(
    "kind", [MerapError, InputError, EngineError, lambda text: SystemFault("failed", text)]
)
def test_no_error_shows_a_secret(kind: type[MerapError]) -> None:
    error = kind("can't reach http://me:s3cret@host: password=s3cret")
    assert "s3cret" not in f"{error} {error!r} {vars(error)}"
    assert "http://***@host" in str(error)
