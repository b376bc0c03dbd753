"""Decide in time: work that may be late runs beside its caller, in the order in which it was handed over."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import AbstractContextManager
from enum import StrEnum
from typing import Any, TypeVar

from merap.systems.worker import Worker

Result = TypeVar("Result")


class Lateness(StrEnum):
    """The reason why there is no decision in time; a repetition from records is late in the same way.

    `LATE`: the work was begun, after all work before it. `BUSY`: it was not, and never will be.
    """

    LATE = "the plan was late"
    BUSY = "the learner was busy with earlier steps"


class DeadlineRunner(AbstractContextManager["DeadlineRunner"]):
    """Run work with an optional time limit.

    All work goes through one thread, one piece after the other, so late work is finished before
    the next piece begins, and nothing runs side by side. One thread hands work over and takes results,
    never a piece of work itself. An error of a piece that nobody waits for is raised by the next call
    after it has ended.

    Attributes:
        patient: whether there is no time limit for now, as where recorded work is repeated.

    Args:
        seconds: the limit of a piece of work that is waited for; None: each is done at once and to its end.
        name: name of the thread.
    """

    def __init__(self, seconds: float | None, name: str = "planner") -> None:
        self._seconds = seconds
        self.patient = False
        self._worker = None if seconds is None else Worker(name)
        self._pending: deque[Future[Any]] = deque()

    def in_time(self, work: Callable[[], Result]) -> Result | Lateness:
        """Return the result, or why it is late; work that has not begun by then is not done at all."""
        if self._worker is None:
            return work()
        future = self.later(work)
        wait([future], None if self.patient else self._seconds)
        if future.cancel():
            return Lateness.BUSY
        self._raise_finished()
        return future.result() if future.done() else Lateness.LATE

    def later(self, work: Callable[[], Result]) -> Future[Result]:
        """Hand work over, to be done before any work that is handed over after it."""
        if self._worker is None:
            return _done(work())
        assert not self._worker.here, "work hands over no work"
        self._raise_finished()
        future = self._worker.submit(work)
        self._pending.append(future)
        return future

    def finish(self) -> None:
        """Wait for all that was handed over, and raise what it has raised."""
        assert self._worker is None or not self._worker.here, "work waits for no work"
        wait(self._pending)
        self._raise_finished()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Take no more work; pieces that have not begun are dropped."""
        if self._worker is not None:
            self._worker.close()

    def _raise_finished(self) -> None:
        while self._pending and self._pending[0].done():
            ended = self._pending.popleft()
            if not ended.cancelled():
                ended.result()


def _done(result: Result) -> Future[Result]:
    future: Future[Result] = Future()
    future.set_result(result)
    return future
