"""Decisions in time: work that may be late is done beside the loop, in the order it was handed over."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from merap.online.managed.worker import Worker

Result = TypeVar("Result")


class Punctual(Generic[Result]):
    """Does work for at most so long; without a limit at once and to its end.

    All work goes through one thread, one piece after the other, so what is late is finished before
    the next piece begins, and nothing runs side by side.

    Attributes:
        patient: nothing is late, for what is repeated.

    Args:
        seconds: for a piece of work that is waited for; None: no limit.
    """

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self.patient = False
        self._worker = None if seconds is None else Worker("planner")
        self._pending: list[Future[Any]] = []

    def in_time(self, work: Callable[[], Result]) -> Result | None:
        """The result; None if it is late, and then nobody asks for it any more."""
        if self._worker is None:
            return work()
        future = self._worker.submit(work)
        self._pending.append(future)
        try:
            return future.result(None if self.patient else self._seconds)
        except TimeoutError:
            return None

    def later(self, work: Callable[[], None]) -> None:
        """Do it before any work that is handed over after it."""
        if self._worker is None:
            work()
        else:
            self._pending.append(self._worker.submit(work))

    def finish(self) -> None:
        """Wait for all that was handed over; raises what it has raised."""
        pending, self._pending = self._pending, []
        for future in pending:
            future.result()
