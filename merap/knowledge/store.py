"""Transactions on a database: committed whole or not at all, patient with locks, clear when they fail."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from sqlalchemy import URL, Connection
from sqlalchemy.exc import SQLAlchemyError

from merap.errors import MerapError, StorageError
from merap.knowledge.engine import for_writing, make_engine, place
from merap.knowledge.faults import translated
from merap.knowledge.patience import Patience, patiently

Result = TypeVar("Result")


class Store:
    """A database that several threads may use, one at a time.

    Args:
        url: as `read_url` has it.
        patience: with a lock that another process holds.
        notice: is told of such waiting, in one line.
    """

    def __init__(self, url: URL, patience: Patience, notice: Callable[[str], None]) -> None:
        self.place = place(url)
        self._engine = make_engine(url)
        self._writer = for_writing(self._engine)
        self._patience = patience
        self._notice = notice
        self._lock = threading.RLock()
        self._open: Connection | None = None
        self._failed = False

    def close(self) -> None:
        """Give the connections back."""
        self._engine.dispose()

    def read(self, work: Callable[[Connection], Result]) -> Result:
        """The result of some reading; inside a transaction it sees what that has written.

        Raises:
            StorageError: it can't be read.
        """
        with self._lock:
            if self._open is not None:
                return self._within(self._open, work)
            return self._patiently(lambda: self._once(work))

    def write(self, work: Callable[[Connection], Result]) -> Result:
        """The result of some writing, committed unless a transaction is open.

        Raises:
            StorageError: it can't be written; nothing of it is kept.
        """
        with self._lock:
            if self._open is not None:
                return self._within(self._open, work)
            return self._patiently(lambda: self._committed(work))

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """What the block writes is committed at its end, or not at all; one inside another joins it.

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
                with translated(self.place):
                    self._open.commit()
            finally:
                self._open.close()
                self._open, self._failed = None, False

    def _within(self, connection: Connection, work: Callable[[Connection], Result]) -> Result:
        # a database may have ended a transaction in which something failed: nothing more belongs to it
        if self._failed:
            raise self._given_up()
        try:
            with translated(self.place):
                return work(connection)
        except MerapError:
            self._failed = True
            raise

    def _given_up(self) -> StorageError:
        return StorageError(f"{self.place}: a part of the transaction failed; nothing of it is kept")

    def _patiently(self, attempt: Callable[[], Result]) -> Result:
        return patiently(attempt, self._patience, self._notice, self.place)

    def _once(self, work: Callable[[Connection], Result]) -> Result:
        with translated(self.place), self._engine.connect() as connection:
            return work(connection)

    def _committed(self, work: Callable[[Connection], Result]) -> Result:
        with translated(self.place), self._writer.begin() as connection:
            return work(connection)

    def _begun(self) -> Connection:
        with translated(self.place):
            connection = self._writer.connect()
            try:
                connection.begin()
            except SQLAlchemyError:
                connection.close()
                raise
            return connection
