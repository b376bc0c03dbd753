"""Keep the log: JSON lines in a file, and the same events in the knowledge base.

A handler of the `logging` module would swallow what goes wrong when it writes; here it is told.
"""

from __future__ import annotations

import json
import math
import os
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from merap.errors import MerapError, StorageError
from merap.knowledge.base import KnowledgeBase
from merap.knowledge.export import event_record
from merap.knowledge.rows import EventRow, Level, now
from merap.masking import masked, masked_data

FILE_NAME = "events.jsonl"
MOST_WAITING = 10_000


class JsonLines:
    """A file that grows by a line for each event; every line is in the file when `write` returns.

    A last line that was cut short by a kill is closed, so that the lines after it can be read. An
    error of merap that ends the block in which the file is open is its last event.

    Args:
        path: appended to if it is there.

    Raises:
        StorageError: it can't be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        with _told(path):
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            size = os.fstat(self._file).st_size
            if size and os.pread(self._file, 1, size - 1) != b"\n":
                os.write(self._file, b"\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, MerapError):
            with suppress(StorageError):  # the error itself is what matters
                self.write(EventRow(now(), "run", "error", str(error)))
        self.close()

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def write(self, row: EventRow) -> None:
        """Append an event.

        Raises:
            StorageError: it can't be written.
        """
        line = memoryview(f"{json.dumps(event_record(row))}\n".encode())
        with self._lock, _told(self._path):
            while line:
                line = line[os.write(self._file, line) :]

    def notice(self, message: str) -> None:
        """Append what a knowledge base says of itself; see `open_knowledge`."""
        self.write(EventRow(now(), "knowledge", "warning", message))


@contextmanager
def _told(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StorageError(f"{path}: can't be written: {error.strerror}") from error


class EventLog:
    """The log of a run: each event in the file, then in the knowledge base. Threads may share it.

    While the knowledge base can't be written, events wait in memory, in order, and are recorded
    with the next one; only when too many wait is it an error. They are in the file in any case.

    Args:
        lines: the file; None: there is none.
        knowledge: open.
        run: the run's number there.
        most_waiting: events.
    """

    def __init__(
        self, lines: JsonLines | None, knowledge: KnowledgeBase, run: int, most_waiting: int = MOST_WAITING
    ) -> None:
        self._lines = lines
        self._knowledge = knowledge
        self._run = run
        self._most = most_waiting
        self._waiting: deque[EventRow] = deque()
        self._lock = threading.RLock()

    def event(self, component: str, level: Level, message: str, **data: object) -> None:
        """Record that something has happened.

        Args:
            component: the part of the loop that says it.
            level: its severity.
            message: one line.
            data: figures; those without a JSON form are written as text.

        Raises:
            StorageError: the file can't be written, or too many events wait for the knowledge base.
        """
        row = event_row(component, level, message, **data)
        with self._lock:
            if self._lines is not None:
                self._lines.write(row)
            self._waiting.append(row)
            try:
                self.flush()
            except StorageError as error:
                if len(self._waiting) > self._most:
                    raise
                if self._lines is not None:
                    self._lines.notice(f"{error}; {len(self._waiting)} events wait")

    def flush(self) -> None:
        """Record what waits.

        Raises:
            StorageError: the knowledge base can't be written; all still wait.
        """
        with self._lock:
            with self._knowledge.transaction():
                for row in self._waiting:
                    self._knowledge.record_event(self._run, row)
            self._waiting.clear()


def event_row(component: str, level: Level, message: str, **data: object) -> EventRow:
    """Build an event of now, without secrets; the arguments are those of `EventLog.event`."""
    shown = masked(" ".join(message.split()))
    return EventRow(now(), component, level, shown, masked_data(plain(data)))


def plain(value: Any) -> Any:
    """Put a value in JSON's terms; NaN, infinities and everything that JSON can't write become text."""
    match value:
        case None | bool() | int() | str():
            return value
        case float() if math.isfinite(value):
            return float(value)
        case np.generic() | np.ndarray():
            return plain(value.tolist())
        case Mapping():
            return {str(key): plain(entry) for key, entry in value.items()}
        case list() | tuple():
            return [plain(entry) for entry in value]
        case _:
            return str(value)
