"""Decisions in time: work that may be late is done beside its caller, in the order it was handed over."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, Generic, TypeVar

from merap.online.managed.worker import Worker

Result = TypeVar("Result")
Other = TypeVar("Other")


class Punctual(Generic[Result]):
    """Does work for at most so long; without a limit at once and to its end.

    All work goes through one thread, one piece after the other, so what is late is finished before
    the next piece begins, and nothing runs side by side. What a piece raises that nobody waits for comes
    out with the next call after it has ended.

    Attributes:
        patient: nothing is late, for what is repeated.

    Args:
        seconds: for a piece of work that is waited for; None: no limit.
        name: of the thread.
    """

    def __init__(self, seconds: float | None, name: str = "planner") -> None:
        self._seconds = seconds
        self.patient = False
        self._worker = None if seconds is None else Worker(name)
        self._pending: deque[Future[Any]] = deque()
        self._late: Future[Result] | None = None

    def in_time(self, work: Callable[[], Result]) -> Result | None:
        """The result; None if it is late, and then it may be had from `late_result`."""
        if self._worker is None:
            return work()
        future = self._post(self._worker, work)
        wait([future], None if self.patient else self._seconds)
        if future.done():
            return self._result(future)
        self._late = future
        return None

    def late_result(self) -> Result:
        """The result of the piece that was late last, waited for."""
        assert self._late is not None, "nothing was late"
        return self._result(self._late)

    def result(self, work: Callable[[], Other]) -> Other:
        """The result, however long it takes, after all that was handed over before."""
        return work() if self._worker is None else self._result(self._post(self._worker, work))

    def later(self, work: Callable[[], None]) -> None:
        """Do it before any work that is handed over after it."""
        if self._worker is None:
            work()
        else:
            self._post(self._worker, work)

    def finish(self) -> None:
        """Wait for all that was handed over; raises what it has raised."""
        wait(self._pending)
        self._raise_finished()

    def _post(self, worker: Worker, work: Callable[[], Other]) -> Future[Other]:
        self._raise_finished()
        future = worker.submit(work)
        self._pending.append(future)
        return future

    def _result(self, asked: Future[Other]) -> Other:
        """Waits; if a piece before it has failed, that is what is raised."""
        wait([asked])
        self._raise_finished()
        return asked.result()

    def _raise_finished(self) -> None:
        while self._pending and self._pending[0].done():
            self._pending.popleft().result()
