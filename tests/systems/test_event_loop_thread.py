from __future__ import annotations

import asyncio
import subprocess
import sys
import threading

import pytest

from merap.systems.http_client import EventLoopThread

pytestmark = pytest.mark.process


def test_it_runs_work_in_its_thread_and_gives_the_result() -> None:
    thread = EventLoopThread("own")

    async def name() -> str:
        await asyncio.sleep(0)
        return threading.current_thread().name

    assert thread.run(name()) == "own"
    assert thread.run(name()) == "own"
    thread.stop()
    assert "own" not in {other.name for other in threading.enumerate()}


def test_what_the_work_raises_is_raised_to_the_caller() -> None:
    thread = EventLoopThread("own")

    async def late() -> None:
        async with asyncio.timeout(0.01):
            await asyncio.sleep(60)

    with pytest.raises(TimeoutError):
        thread.run(late())
    thread.stop()


def test_a_client_that_is_never_closed_does_not_keep_the_process_from_ending() -> None:
    script = (
        "from merap.systems.http_client import UpisasClient; client = UpisasClient('http://127.0.0.1:9', 1)"
    )
    assert subprocess.run([sys.executable, "-c", script], timeout=120, check=False).returncode == 0
