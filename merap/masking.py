"""Mask passwords and tokens of URLs and connection strings in everything that is shown, logged or stored.

A URL is shown as `scheme://user:***@host/path?key=***`. The values of a query are masked whatever their keys
are called, and so is the user name of an HTTP URL, since either may be a token.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qsl, quote, quote_plus, unquote, unquote_plus

MASK = "***"
# Shorter ones are masked in URLs only: in a message they would match parts of ordinary words.
SHORTEST = 3
_HTTP = ("http", "https")
_SCHEME = re.compile(r"[A-Za-z][\w+.-]*", re.ASCII)
_NAMES_A_SECRET = re.compile(
    r"password|passwd|passphrase|pwd|secret|credential|authorization|token(?![a-z])"
    r"|(?:api|access|private)[_-]?key",
    re.IGNORECASE,
)
_SHOWS_A_SECRET = re.compile(
    r"(?P<url>[A-Za-z][A-Za-z0-9+.-]*://\S*[^\s:,;.)'\"\]}>])"
    r"|(?P<key>[\w.-]*(?:password|passwd|passphrase|pwd)\s*=\s*)(?:'(?:[^'\\]|\\.)*'|\S+)"
    r"|:[^\s@:][^\s@]*@(?:[^\s@]*@)*",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class SplitUrl:
    """The parts of a URL that decide what is secret in it.

    Attributes:
        scheme: in lower case.
        user: before the first colon of the credentials, still quoted; None: there are no credentials.
        password: after that colon, still quoted; None: there is none.
        place: host, port and path.
        query: after the question mark, still quoted; None: there is none.
    """

    scheme: str
    user: str | None = field(repr=False)
    password: str | None = field(repr=False)
    place: str
    query: str | None = field(repr=False)

    @property
    def bare(self) -> str:
        """The URL without credentials and query."""
        return f"{self.scheme}://{self.place}"

    @property
    def parameters(self) -> list[tuple[str, str]]:
        """The keys and values of the query, unquoted."""
        return parse_qsl(self.query or "", keep_blank_values=True)


def split_url(url: str) -> SplitUrl | None:
    """Split a URL; credentials end at the last `@` that can belong to them, so a password may hold one.

    Returns:
        None if the text has no scheme.
    """
    scheme, separator, rest = url.partition("://")
    if not separator or _SCHEME.fullmatch(scheme) is None:
        return None
    scheme = scheme.lower()
    end = _end_of_credentials(rest, scheme)
    credentials, rest = (None, rest) if end is None else (rest[:end], rest[end + 1 :])
    place, asked, query = rest.partition("?")
    place, _, _ = place.partition("#")
    query, _, _ = query.partition("#")
    if credentials is None:
        return SplitUrl(scheme, None, None, place, query if asked else None)
    user, colon, password = credentials.partition(":")
    return SplitUrl(scheme, user, password if colon else None, place, query if asked else None)


def _end_of_credentials(rest: str, scheme: str) -> int | None:
    """Return the position of the `@` that ends the credentials."""
    authority = re.split(r"[/?#]", rest, maxsplit=1)[0]
    if "@" in authority:
        return authority.rindex("@")
    # Without one in its usual place, `user:a/b@host` has a slash in its password, `host:3000/a@b` has a port.
    user, colon, port = authority.partition(":")
    if not (user and colon) or (scheme in _HTTP and (port.isdigit() or not port)):
        return None
    path, _, _ = rest.partition("?")
    if "@" in path:
        return path.rindex("@")
    return rest.rindex("@") if path == authority and "@" in rest and not port.isdigit() else None


def masked_url(url: str) -> str:
    """Return a URL as it may be shown; any other text as `masked` has it."""
    parts = split_url(url)
    if parts is None:
        return masked(url)
    if parts.user is None:
        return f"{parts.scheme}://{parts.place}{_masked_query(parts.query)}"
    if parts.scheme in _HTTP or not parts.user:
        credentials = MASK
    else:
        credentials = parts.user if parts.password is None else f"{parts.user}:{MASK}"
    # Another `@` leaves open where the password ends.
    place = MASK if "@" in parts.place + (parts.query or "") else parts.place + _masked_query(parts.query)
    return f"{parts.scheme}://{credentials}@{place}"


def _masked_query(query: str | None) -> str:
    if query is None:
        return ""
    pairs = [part.partition("=") for part in query.split("&")]
    return "?" + "&".join(f"{key}={MASK}" if equals else MASK for key, equals, _ in pairs)


def names_a_secret(key: str) -> bool:
    """Tell whether a value under a key, as `sslpassword` or `api_key`, is secret by its name."""
    return _NAMES_A_SECRET.search(key) is not None


def secrets_in(value: Any, key: str = "") -> tuple[str, ...]:
    """Return the secrets of a URL, or of JSON-like data, the longest first; see `masked`.

    They are given as they stand and in every form in which a driver may quote them.
    """
    return tuple(sorted(set(_forms(_found_in(value, key))), key=lambda text: (-len(text), text)))


def _found_in(value: Any, key: str) -> Iterator[str]:
    if isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _found_in(entry, str(name))
    elif isinstance(value, list | tuple):
        for entry in value:
            yield from _found_in(entry, key)
    elif isinstance(value, str):
        parts = split_url(value)
        if names_a_secret(key):
            yield value
        elif parts is not None:
            yield from _found_in_url(parts)


def _found_in_url(parts: SplitUrl) -> Iterator[str]:
    http = parts.scheme in _HTTP
    yield parts.password or (http and parts.user) or ""
    for key, value in parts.parameters:
        if http or names_a_secret(key):
            yield value


def _forms(secrets: Iterable[str]) -> Iterator[str]:
    for secret in secrets:
        for text in (secret, unquote(secret), unquote_plus(secret)):
            yield from (
                form for form in (text, quote(text, safe=""), quote_plus(text)) if len(form) >= SHORTEST
            )


def masked(text: str, secrets: Iterable[str] = ()) -> str:
    """Return a text as it may be shown: without the given secrets, and without those of any URL in it.

    Args:
        text: a message, which may quote URLs and connection strings.
        secrets: from `secrets_in`, the longest first.
    """
    for secret in secrets:
        text = text.replace(secret, MASK)
    return _SHOWS_A_SECRET.sub(_masked_match, text)


def _masked_match(match: re.Match[str]) -> str:
    if match["url"] is not None:
        return masked_url(match["url"])
    return f"{match['key']}{MASK}" if match["key"] is not None else f":{MASK}@"


def masked_data(value: Any, key: str = "") -> Any:
    """Return JSON-like data as it may be stored: texts masked, and all that a key like `api_key` names."""
    if names_a_secret(key) and value is not None:
        return MASK
    if isinstance(value, Mapping):
        return {name: masked_data(entry, str(name)) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [masked_data(entry, key) for entry in value]
    return masked_url(value) if isinstance(value, str) else value
