"""Decisions in time: work that may be late is done beside the loop, in the order it was handed over."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any, Generic, TypeVar

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
        self._pool = None if seconds is None else ThreadPoolExecutor(max_workers=1)
        self._pending: list[Future[Any]] = []

    def __enter__(self) -> Punctual[Result]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)

    def in_time(self, work: Callable[[], Result]) -> Result | None:
        """The result; None if it is late, and then nobody asks for it any more."""
        if self._pool is None:
            return work()
        future = self._pool.submit(work)
        self._pending.append(future)
        try:
            return future.result(None if self.patient else self._seconds)
        except TimeoutError:
            return None

    def later(self, work: Callable[[], None]) -> None:
        """Do it before any work that is handed over after it."""
        if self._pool is None:
            work()
        else:
            self._pending.append(self._pool.submit(work))

    def finish(self) -> None:
        """Wait for all that was handed over; raises what it has raised."""
        pending, self._pending = self._pending, []
        for future in pending:
            future.result()
