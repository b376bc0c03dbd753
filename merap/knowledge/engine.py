"""Connect to SQLite in WAL mode or to PostgreSQL, from a URL.

SQLite is opened with `synchronous = FULL`: the log is flushed to the disk by every commit, so that
nothing committed is lost by a kill, and by a power cut only if the disk lies about its flushes.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from merap.errors import InputError, StorageError
from merap.masking import SplitUrl, masked, masked_url, secrets_in, split_url

FILE_NAME = "knowledge.db"
ALLOWED = "sqlite:///FILE or postgresql://USER@HOST/DATABASE"
APPLICATION = int.from_bytes(b"mrap", "big")  # SQLite's mark for files of an application
SCHEMA_NAME = "merap"  # of PostgreSQL: our tables beside those of others
LOCK_WAIT_MS = 1000  # for one try; `Store` tries again
PRAGMAS = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON")
_BEGIN = "merap_begin"


def default_url(folder: Path) -> str:
    """Return the URL of the knowledge base in a folder of results."""
    return f"sqlite:///{folder / FILE_NAME}"


def url_of(place: str) -> str:
    """Return the URL of a knowledge base that is named by URL, by its file, or by the folder of a run.

    Raises:
        InputError: it is a connection string of another form.
    """
    if "://" in place:
        return place
    if masked(place) != place:
        raise InputError(f"{masked(place)!r} is a connection string; expected a folder, a file or {ALLOWED}")
    return default_url(Path(place)) if Path(place).is_dir() else f"sqlite:///{place}"


@dataclass(frozen=True)
class DatabaseUrl:
    """The place of a database, apart from its secrets.

    Attributes:
        url: without secrets.
        place: its name in errors: a file, or the URL with its secrets masked.
        arguments: arguments of the driver's `connect`, by their names; secret ones among them.
        secrets: texts that must not be shown, in every form in which the driver may repeat them.
    """

    url: URL
    place: str
    arguments: Mapping[str, str] = field(default_factory=dict, repr=False)
    secrets: tuple[str, ...] = field(default=(), repr=False)


def read_url(text: str) -> DatabaseUrl:
    """Read a URL that can be opened.

    Raises:
        InputError: it can't.
    """
    parts = split_url(text)
    refusal = InputError(f"can't be a knowledge base; expected {ALLOWED}", source=masked_url(text))
    try:
        url = make_url(text if parts is None or parts.user is None else _without_credentials(parts))
    except (ArgumentError, ValueError) as error:
        raise InputError(f"{masked_url(text)!r} is no URL of a database; expected {ALLOWED}") from error
    backend = url.get_backend_name()
    if parts is None or (backend == "sqlite" and (parts.user is not None or url.query)):
        raise refusal
    if backend == "sqlite" and url.database not in {None, "", ":memory:"}:
        return DatabaseUrl(url.set(drivername="sqlite"), str(url.database))
    if backend != "postgresql":
        raise refusal
    return _postgresql(url, parts, masked_url(f"{backend}{text[len(parts.scheme) :]}"), secrets_in(text))


def _without_credentials(parts: SplitUrl) -> str:
    return parts.bare if parts.query is None else f"{parts.bare}?{parts.query}"


def _postgresql(url: URL, parts: SplitUrl, place: str, secrets: tuple[str, ...]) -> DatabaseUrl:
    if find_spec("psycopg") is None:
        raise InputError("PostgreSQL needs psycopg: pip install 'merap[postgresql]'", source=place)
    if parts.user is not None and "@" in parts.place:
        raise InputError("write an @ in a password as %40, and one in a name too", source=place)
    # Several hosts are for SQLAlchemy to put together; all else the driver reads alike, and shows nowhere.
    arguments = {key: value for key, value in parts.parameters if value and key not in {"host", "port"}}
    if parts.password is not None:
        arguments.setdefault("password", unquote(parts.password))
    url = url.set(
        drivername="postgresql+psycopg", username=unquote(parts.user) if parts.user else None
    ).difference_update_query(arguments)
    return DatabaseUrl(url, place, arguments, secrets)


def require_ours(database: DatabaseUrl, *, create: bool) -> None:
    """Look at a file before anything is written to it.

    Args:
        database: database of the knowledge base.
        create: whether a file that is missing or empty shall become one.

    Raises:
        InputError: it is the file of something else, or missing.
    """
    url = database.url
    if url.get_backend_name() != "sqlite":
        return
    path = Path(url.database or "")
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {path.parent}", source=str(path))
    if path.is_dir():
        raise InputError("is a folder, expected the file of a knowledge base", source=str(path))
    if not path.exists() or path.stat().st_size == 0:
        if not create:
            raise InputError("there is no knowledge base", source=str(path))
        return
    _require_mark(path)


def _require_mark(path: Path) -> None:
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=rw", uri=True, timeout=30)) as file:
            (mark,) = file.execute("PRAGMA application_id").fetchone()
            (objects,) = file.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.OperationalError as error:
        raise StorageError(f"{path}: can't be opened: {error}") from error
    except sqlite3.DatabaseError as error:
        raise InputError(f"is damaged, or no knowledge base: {error}", source=str(path)) from error
    if mark != APPLICATION and objects:
        raise InputError("is a SQLite database of something else", source=str(path))


def make_engine(database: DatabaseUrl) -> Engine:
    """Make an engine whose connections are set up; nothing is opened yet."""
    url = database.url
    if url.get_backend_name() == "sqlite":
        engine = create_engine(
            url,
            connect_args={"isolation_level": None, "timeout": LOCK_WAIT_MS / 1000},
        )
        event.listen(engine, "connect", _set_up_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    engine = create_engine(url, pool_pre_ping=True, connect_args=dict(database.arguments))
    event.listen(engine, "connect", _set_up_postgresql)
    return engine


def for_writing(engine: Engine) -> Engine:
    """Return the same connections, whose transactions take SQLite's write lock when they begin."""
    return engine.execution_options(**{_BEGIN: "BEGIN IMMEDIATE"})


def _set_up_sqlite(connection: Any, _record: object) -> None:
    with closing(connection.cursor()) as cursor:
        for pragma in PRAGMAS:
            cursor.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    # the driver would begin late, and as a reader: then two writers can refuse each other
    connection.exec_driver_sql(connection.get_execution_options().get(_BEGIN, "BEGIN"))


def _set_up_postgresql(connection: Any, _record: object) -> None:
    connection.autocommit = True
    with closing(connection.cursor()) as cursor:
        cursor.execute(f"SET search_path = {SCHEMA_NAME}")
        cursor.execute(f"SET lock_timeout = {LOCK_WAIT_MS}")
        cursor.execute("SET synchronous_commit = on")
    connection.autocommit = False
