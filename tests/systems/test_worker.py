from __future__ import annotations

import gc
import subprocess
import sys
import threading
import time
import weakref

import pytest

from merap.systems import worker as module
from merap.systems.worker import Worker

pytestmark = pytest.mark.process


def test_calls_are_made_one_after_the_other() -> None:
    gate = threading.Event()
    with Worker("test") as worker:
        first = worker.submit(lambda: gate.wait(60))
        second = worker.submit(gate.is_set)
        assert not second.done()
        gate.set()
        assert first.result(60)
        assert second.result(60)


def test_what_a_call_raises_is_raised_where_its_result_is_asked_for() -> None:
    with Worker("test") as worker:
        with pytest.raises(ZeroDivisionError):
            worker.submit(lambda: 1 / 0).result(10)
        assert worker.submit(lambda: 1).result(10) == 1


def test_a_call_that_hangs_does_not_keep_the_process_from_ending() -> None:
    script = (
        "import threading; from merap.systems.worker import Worker; "
        "Worker('test').submit(threading.Event().wait)"
    )
    assert subprocess.run([sys.executable, "-c", script], timeout=60, check=False).returncode == 0


def test_what_is_cancelled_before_it_has_begun_is_passed_over() -> None:
    done: list[str] = []
    gate = threading.Event()
    with Worker("test") as worker:
        worker.submit(lambda: gate.wait(60))
        second = worker.submit(lambda: done.append("second"))
        third = worker.submit(lambda: done.append("third"))
        assert second.cancel()
        gate.set()
        third.result(60)
    assert done == ["third"]


def test_it_knows_its_own_thread() -> None:
    with Worker("test") as worker:
        assert worker.submit(lambda: worker.here).result(60)
        assert not worker.here


def test_the_thread_lives_from_the_first_call_until_it_is_closed() -> None:
    before = threading.active_count()
    with Worker("test") as worker:
        assert threading.active_count() == before
        worker.submit(int).result(60)
        assert threading.active_count() == before + 1
    assert threading.active_count() == before
    with pytest.raises(AssertionError, match="the worker is closed"):
        worker.submit(int)


def test_a_call_that_hangs_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LINGER", 0.01)
    before, begun, gate = set(threading.enumerate()), threading.Event(), threading.Event()

    def hang() -> bool:
        begun.set()
        return gate.wait(60)

    with Worker("test") as worker:
        hanging = worker.submit(hang)
        waiting = worker.submit(int)
        assert begun.wait(60)
    assert waiting.cancelled()
    (thread,) = set(threading.enumerate()) - before
    gate.set()
    assert hanging.result(60)
    thread.join(60)
    assert not thread.is_alive()


class Large:
    """What a call may hold on to."""


def test_a_call_that_is_over_is_not_kept_alive() -> None:
    large = Large()
    watched = weakref.ref(large)
    with Worker("test") as worker:
        worker.submit(lambda kept=large: None).result(60)  # type: ignore[misc]
        del large
        until = time.monotonic() + 60
        while watched() is not None and time.monotonic() < until:
            gc.collect()
        assert watched() is None
