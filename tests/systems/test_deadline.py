from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

import pytest

from merap.systems.deadline import DeadlineRunner, Lateness

PATIENCE = 60.0
SHORT = 0.01


def begun_but_late(runner: DeadlineRunner, work: Callable[[], object]) -> None:
    """Asked for until the thread, on however busy a machine, has begun it in time."""
    while (answer := runner.in_time(work)) is Lateness.BUSY:
        pass
    assert answer is Lateness.LATE


def test_without_a_limit_work_is_done_at_once() -> None:
    done: list[str] = []
    runner = DeadlineRunner(None)
    assert runner.later(lambda: done.append("first")).done()
    assert runner.in_time(lambda: [*done, "second"]) == ["first", "second"]
    runner.finish()
    runner.close()


def test_work_in_time_has_its_result() -> None:
    with DeadlineRunner(PATIENCE) as runner:
        assert runner.in_time(lambda: 6 * 7) == 42
        assert runner.in_time(lambda: None) is None


def test_late_work_is_finished_before_the_next_piece() -> None:
    """The first piece waits for a signal that is given after it was found late."""
    done: list[str] = []
    signal = threading.Event()

    def slow() -> None:
        assert signal.wait(PATIENCE)
        done.append("slow")

    with DeadlineRunner(SHORT) as runner:
        begun_but_late(runner, slow)
        runner.later(lambda: done.append("next"))
        assert done == []
        signal.set()
        runner.finish()
    assert done == ["slow", "next"]


def test_work_that_could_not_begin_in_time_is_not_done() -> None:
    done: list[str] = []
    signal = threading.Event()
    with DeadlineRunner(SHORT) as runner:
        before = runner.later(lambda: signal.wait(PATIENCE))
        assert runner.in_time(lambda: done.append("asked in vain")) is Lateness.BUSY
        assert not before.done()
        signal.set()
        runner.later(lambda: done.append("told"))
        runner.finish()
    assert done == ["told"]


def test_while_patient_nothing_is_late() -> None:
    signal = threading.Event()
    with DeadlineRunner(0.001) as runner:
        runner.patient = True
        runner.later(lambda: signal.wait(0.05))
        assert runner.in_time(lambda: signal.wait(0.05)) is False


def test_what_goes_wrong_beside_the_loop_comes_out_at_its_end() -> None:
    def wrong() -> None:
        raise ValueError("no such state")

    with DeadlineRunner(PATIENCE) as runner:
        runner.later(wrong)
        with pytest.raises(ValueError, match="no such state"):
            runner.finish()
        runner.finish()


def test_what_went_wrong_before_comes_out_where_a_result_is_waited_for() -> None:
    def wrong() -> None:
        raise ValueError("no such state")

    with DeadlineRunner(PATIENCE) as runner:
        gate = threading.Event()
        runner.later(lambda: gate.wait(PATIENCE))
        runner.later(wrong)
        threading.Timer(0.01, gate.set).start()
        with pytest.raises(ValueError, match="no such state"):
            runner.in_time(lambda: 1)


def test_work_hands_over_no_work() -> None:
    """It would wait for itself."""
    with DeadlineRunner(PATIENCE) as runner:
        for wrong in (lambda: runner.later(int), lambda: runner.in_time(int), runner.finish):
            runner.later(wrong)
            with pytest.raises(AssertionError, match=r"work (hands over|waits for) no work"):
                runner.finish()


def test_however_threads_take_turns_everything_is_done_in_order(hectic: None) -> None:
    """Ten thousand pieces, a tenth of them waited for; it hangs or miscounts if they meet."""
    done: list[int] = []

    def piece(number: int) -> int:
        done.append(number)
        return len(done)

    with DeadlineRunner(PATIENCE) as runner:
        for first in range(0, 10_000, 10):
            for number in range(first, first + 9):
                runner.later(partial(piece, number))
            assert runner.in_time(partial(piece, first + 9)) == first + 10
            runner.finish()
    assert done == list(range(10_000))


def test_a_closed_one_leaves_no_thread_and_does_nothing_more() -> None:
    name, signal = "a runner that is closed", threading.Event()
    done: list[str] = []

    def is_alive() -> bool:
        return any(thread.name == name for thread in threading.enumerate())

    with DeadlineRunner(PATIENCE, name) as runner:
        assert not is_alive()
        runner.later(lambda: signal.wait(PATIENCE))
        left = runner.later(lambda: done.append("too late"))
        assert is_alive()
        timer = threading.Timer(0.01, signal.set)
        timer.start()
    timer.join()
    assert left.cancelled()
    assert not is_alive()
    assert done == []
