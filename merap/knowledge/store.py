"""Run transactions on a database: committed whole or not at all, and tried again while it is locked."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import NoReturn, TypeVar

import tenacity
from sqlalchemy import Connection
from sqlalchemy.exc import SQLAlchemyError

from merap.errors import MerapError, StorageError
from merap.knowledge.engine import DatabaseUrl, for_writing, make_engine
from merap.knowledge.faults import LockedError, translated

Result = TypeVar("Result")

# Seconds before the second try at a locked database, doubled with each further one, and the longest of them.
FIRST_WAIT = 0.05
LONGEST_WAIT = 1.0


class Store:
    """A database that several threads may use, one at a time.

    Args:
        database: as `read_url` has it.
        lock_timeout: seconds to wait for a lock that another process holds.
        notice: is told of such waiting, in one line.
    """

    def __init__(self, database: DatabaseUrl, lock_timeout: float, notice: Callable[[str], None]) -> None:
        self.place = database.place
        self._translated = partial(translated, database.place, database.secrets)
        with self._translated():
            self._engine = make_engine(database)
        self._writer = for_writing(self._engine)
        self._lock_timeout = lock_timeout
        self._notice = notice
        self._lock = threading.RLock()
        self._open: Connection | None = None
        self._failed = False

    def close(self) -> None:
        """Give the connections back."""
        self._engine.dispose()

    def read(self, work: Callable[[Connection], Result]) -> Result:
        """Return the result of some reading; inside a transaction it sees what that has written.

        Raises:
            StorageError: it can't be read.
        """
        with self._lock:
            if self._open is not None:
                return self._within(self._open, work)
            return self._patiently(lambda: self._once(work))

    def write(self, work: Callable[[Connection], Result]) -> Result:
        """Return the result of some writing, which is committed unless a transaction is open.

        Raises:
            StorageError: it can't be written; nothing of it is kept.
        """
        with self._lock:
            if self._open is not None:
                return self._within(self._open, work)
            return self._patiently(lambda: self._committed(work))

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit what the block writes at its end, or nothing of it; one inside another joins it.

        Raises:
            StorageError: it can't be written; nothing of it is kept.
        """
        with self._lock:
            if self._open is not None:
                yield
                return
            self._open = self._patiently(self._begun)
            try:
                yield
                if self._failed:
                    raise self._given_up()
                with self._translated():
                    self._open.commit()
            finally:
                self._open.close()
                self._open, self._failed = None, False

    def _within(self, connection: Connection, work: Callable[[Connection], Result]) -> Result:
        # a database may have ended a transaction in which something failed: nothing more belongs to it
        if self._failed:
            raise self._given_up()
        try:
            with self._translated():
                return work(connection)
        except MerapError:
            self._failed = True
            raise

    def _given_up(self) -> StorageError:
        return StorageError(f"{self.place}: a part of the transaction failed; nothing of it is kept")

    def _patiently(self, attempt: Callable[[], Result]) -> Result:
        """Make an attempt again until no lock is in its way; one that finds a lock leaves nothing behind."""
        attempts = tenacity.Retrying(
            retry=tenacity.retry_if_exception_type(LockedError),
            stop=tenacity.stop_after_delay(self._lock_timeout),
            wait=tenacity.wait_exponential(FIRST_WAIT, max=LONGEST_WAIT),
            before_sleep=self._tell_waiting,
            retry_error_callback=_gave_up,
        )
        result = attempts(attempt)
        if attempts.statistics["attempt_number"] > 1:
            waited = attempts.statistics["delay_since_first_attempt"]
            self._notice(f"{self.place}: is free again after {waited:.1f} s")
        return result

    def _tell_waiting(self, state: tenacity.RetryCallState) -> None:
        if state.attempt_number == 1 and state.outcome is not None:
            self._notice(f"{state.outcome.exception()}; trying again for {self._lock_timeout:g} s")

    def _once(self, work: Callable[[Connection], Result]) -> Result:
        with self._translated(), self._engine.connect() as connection:
            return work(connection)

    def _committed(self, work: Callable[[Connection], Result]) -> Result:
        with self._translated(), self._writer.begin() as connection:
            return work(connection)

    def _begun(self) -> Connection:
        with self._translated():
            connection = self._writer.connect()
            try:
                connection.begin()
            except SQLAlchemyError:
                connection.close()
                raise
            return connection


def _gave_up(state: tenacity.RetryCallState) -> NoReturn:
    assert state.outcome is not None
    error = state.outcome.exception()
    raise StorageError(f"{error}; gave up after {state.seconds_since_start:.1f} s") from error
