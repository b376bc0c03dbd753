"""Connections: SQLite in WAL mode or PostgreSQL, from a URL.

SQLite is opened with `synchronous = FULL`: the log is flushed to the disk by every commit, so that
nothing committed is lost by a kill, and by a power cut only if the disk lies about its flushes.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from merap.errors import InputError, StorageError

FILE_NAME = "knowledge.db"
ALLOWED = "sqlite:///FILE or postgresql://USER@HOST/DATABASE"
APPLICATION = int.from_bytes(b"mrap", "big")  # SQLite's mark for files of an application
SCHEMA_NAME = "merap"  # of PostgreSQL: our tables beside those of others
LOCK_WAIT_MS = 1000  # for one try; `Patience` tries again
PRAGMAS = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON")
_BEGIN = "merap_begin"


def default_url(folder: Path) -> str:
    """The knowledge base in a folder of results."""
    return f"sqlite:///{folder / FILE_NAME}"


def url_of(place: str) -> str:
    """The URL of a knowledge base that is named by URL, by its file, or by the folder of a run."""
    if "://" in place:
        return place
    return default_url(Path(place)) if Path(place).is_dir() else f"sqlite:///{place}"


def read_url(text: str) -> URL:
    """A URL that can be opened.

    Raises:
        InputError: it can't.
    """
    try:
        url = make_url(text)
    except (ArgumentError, ValueError) as error:
        raise InputError(f"{text!r} is no URL of a database; expected {ALLOWED}") from error
    backend = url.get_backend_name()
    if backend == "sqlite" and url.database not in {None, "", ":memory:"} and not url.query:
        return url.set(drivername="sqlite")
    if backend == "postgresql":
        if find_spec("psycopg") is None:
            raise InputError("PostgreSQL needs psycopg: pip install 'merap[postgresql]'", source=place(url))
        return url.set(drivername="postgresql+psycopg")
    raise InputError(f"can't be a knowledge base; expected {ALLOWED}", source=place(url))


def place(url: URL) -> str:
    """What errors call it: no password in it."""
    if url.get_backend_name() == "sqlite":
        return url.database or str(url)
    return url.set(drivername=url.get_backend_name()).render_as_string(hide_password=True)


def require_ours(url: URL, *, create: bool) -> None:
    """Look at a file before anything is written to it.

    Args:
        url: of the knowledge base.
        create: a file that is missing or empty shall become one.

    Raises:
        InputError: it is the file of something else, or missing.
    """
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


def make_engine(url: URL) -> Engine:
    """An engine whose connections are set up; nothing is opened yet."""
    if url.get_backend_name() == "sqlite":
        engine = create_engine(
            url,
            connect_args={"isolation_level": None, "timeout": LOCK_WAIT_MS / 1000},
        )
        event.listen(engine, "connect", _set_up_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    engine = create_engine(url, pool_pre_ping=True)
    event.listen(engine, "connect", _set_up_postgresql)
    return engine


def for_writing(engine: Engine) -> Engine:
    """The same connections, whose transactions take SQLite's write lock when they begin."""
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
