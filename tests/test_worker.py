from __future__ import annotations

import subprocess
import sys
import threading

import pytest

from merap.online.managed.worker import Worker


def test_calls_are_made_one_after_the_other() -> None:
    worker, gate = Worker("test"), threading.Event()
    first = worker.submit(lambda: gate.wait(60))
    second = worker.submit(gate.is_set)
    assert not second.done()
    gate.set()
    assert first.result(60)
    assert second.result(60)


def test_what_a_call_raises_is_raised_where_its_result_is_asked_for() -> None:
    worker = Worker("test")
    with pytest.raises(ZeroDivisionError):
        worker.submit(lambda: 1 / 0).result(10)
    assert worker.submit(lambda: 1).result(10) == 1


def test_a_call_that_hangs_does_not_keep_the_process_from_ending() -> None:
    script = (
        "import threading; from merap.online.managed.worker import Worker; "
        "Worker('test').submit(threading.Event().wait)"
    )
    assert subprocess.run([sys.executable, "-c", script], timeout=60, check=False).returncode == 0
