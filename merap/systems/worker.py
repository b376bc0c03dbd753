"""Make calls one after the other in a thread, so that a caller can stop waiting."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

Result = TypeVar("Result")

# Seconds that a call under way is waited for when its worker is closed.
LINGER = 1.0


class Worker(AbstractContextManager["Worker"]):
    """Carry out calls in their order; one that hangs does not keep the process from ending.

    The thread begins with the first call and ends with `close`. A future that is cancelled before its
    call has begun is passed over.

    Args:
        name: name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._calls: SimpleQueue[tuple[Callable[[], Any], Future[Any]] | None] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._closed = False

    @property
    def here(self) -> bool:
        """Whether the current thread is the worker's own."""
        return threading.current_thread() is self._thread

    def submit(self, call: Callable[[], Result]) -> Future[Result]:
        """Carry out a call after all that were submitted before."""
        assert not self._closed, "the worker is closed"
        if self._thread is None:
            # A thread of an executor would be waited for when the process ends.
            self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
            self._thread.start()
        future: Future[Result] = Future()
        self._calls.put((call, future))
        return future

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Cancel calls that have not begun, and end the thread; one that hangs is left to itself."""
        self._closed = True
        if self._thread is None:
            return
        self._cancel_all()
        self._calls.put(None)
        self._thread.join(LINGER)

    def _cancel_all(self) -> None:
        try:
            while (queued := self._calls.get_nowait()) is not None:
                queued[1].cancel()
        except Empty:
            return

    def _run(self) -> None:
        while (queued := self._calls.get()) is not None:
            _carry_out(*queued)
            # While it waits for the next call it keeps nothing of this one alive.
            del queued


def _carry_out(call: Callable[[], Any], future: Future[Any]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(call())
    except BaseException as error:  # noqa: BLE001 (whoever waits gets it)
        future.set_exception(error)
