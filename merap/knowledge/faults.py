"""Turn a database's complaint into one line, and tell whether another try is worth it."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import contextmanager

from sqlalchemy.exc import ArgumentError, DBAPIError, StatementError

from merap.errors import InputError, MerapError, StorageError
from merap.knowledge.tables import CHECKPOINT_EPISODE
from merap.masking import masked

_KEPT = "what was committed is kept"
_LOCKED = "is locked by another process"
_TAKEN = "another process goes on with this run and has kept the same episode; nothing of this one is kept"
_SQLITE = {
    sqlite3.SQLITE_BUSY: _LOCKED,
    sqlite3.SQLITE_LOCKED: _LOCKED,
    sqlite3.SQLITE_FULL: f"the disk is full; {_KEPT}",
    sqlite3.SQLITE_IOERR: f"the disk can't be read or written; {_KEPT}",
    sqlite3.SQLITE_READONLY: "may not be written",
    sqlite3.SQLITE_CANTOPEN: "can't be opened",
}
_SQLITE_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}
_POSTGRESQL = {
    "55P03": _LOCKED,  # lock_not_available
    "40P01": _LOCKED,  # deadlock_detected
    "40001": _LOCKED,  # serialization_failure
    "53100": f"the disk is full; {_KEPT}",
    "53300": "has too many connections",
    "42501": "may not be written",
}


class LockedError(StorageError):
    """Another process holds a lock; the next try may succeed."""


@contextmanager
def translated(place: str, secrets: Collection[str] = ()) -> Iterator[None]:
    """Turn errors of a database into one clear line.

    Args:
        place: place of the knowledge base.
        secrets: texts that the driver may repeat and nobody shall see.

    Raises:
        LockedError: another process holds a lock.
        StorageError: it can't be read or written.
        InputError: a row to be written, or the file, is wrong.
    """
    try:
        yield
    except StatementError as error:
        raise _fault(error, place, secrets) from error
    except (ArgumentError, UnicodeError) as error:
        raise InputError(f"can't be connected to: {masked(str(error), secrets)}", source=place) from error


def _fault(error: StatementError, place: str, secrets: Collection[str]) -> MerapError:
    cause = error.orig
    detail = masked(" ".join(str(cause).split()), secrets)
    if not isinstance(error, DBAPIError):
        return InputError(f"can't be recorded: {detail}", source=place)
    if CHECKPOINT_EPISODE in detail:
        return StorageError(f"{place}: {_TAKEN}")
    if isinstance(cause, sqlite3.Error):
        code = getattr(cause, "sqlite_errorcode", 0) & 0xFF  # without the extended part
        if code in _SQLITE_DAMAGED:
            return InputError(f"is damaged, or no knowledge base: {detail}", source=place)
        reason = _SQLITE.get(code)
    else:
        reason = _POSTGRESQL.get(str(getattr(cause, "sqlstate", "")))
        if reason is None and error.connection_invalidated:
            reason = "the connection is lost"
    kind = LockedError if reason == _LOCKED else StorageError
    return kind(f"{place}: {reason} ({detail})" if reason else f"{place}: {detail}")
