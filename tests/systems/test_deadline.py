from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

import pytest

from merap.systems.deadline import Lateness, Punctual

PATIENCE = 60.0
SHORT = 0.01


def begun_but_late(punctual: Punctual, work: Callable[[], object]) -> None:
    """Asked for until the thread, on however busy a machine, has begun it in time."""
    while (answer := punctual.in_time(work)) is Lateness.BUSY:
        pass
    assert answer is Lateness.LATE


def test_without_a_limit_work_is_done_at_once() -> None:
    done: list[str] = []
    punctual = Punctual(None)
    assert punctual.later(lambda: done.append("first")).done()
    assert punctual.in_time(lambda: [*done, "second"]) == ["first", "second"]
    punctual.finish()
    punctual.close()


def test_work_in_time_has_its_result() -> None:
    with Punctual(PATIENCE) as punctual:
        assert punctual.in_time(lambda: 6 * 7) == 42
        assert punctual.in_time(lambda: None) is None


def test_late_work_is_finished_before_the_next_piece() -> None:
    """The first piece waits for a signal that is given after it was found late."""
    done: list[str] = []
    signal = threading.Event()

    def slow() -> None:
        assert signal.wait(PATIENCE)
        done.append("slow")

    with Punctual(SHORT) as punctual:
        begun_but_late(punctual, slow)
        punctual.later(lambda: done.append("next"))
        assert done == []
        signal.set()
        punctual.finish()
    assert done == ["slow", "next"]


def test_work_that_could_not_begin_in_time_is_not_done() -> None:
    done: list[str] = []
    signal = threading.Event()
    with Punctual(SHORT) as punctual:
        before = punctual.later(lambda: signal.wait(PATIENCE))
        assert punctual.in_time(lambda: done.append("asked in vain")) is Lateness.BUSY
        assert not before.done()
        signal.set()
        punctual.later(lambda: done.append("told"))
        punctual.finish()
    assert done == ["told"]


def test_while_patient_nothing_is_late() -> None:
    signal = threading.Event()
    with Punctual(0.001) as punctual:
        punctual.patient = True
        punctual.later(lambda: signal.wait(0.05))
        assert punctual.in_time(lambda: signal.wait(0.05)) is False


def test_what_goes_wrong_beside_the_loop_comes_out_at_its_end() -> None:
    def wrong() -> None:
        raise ValueError("no such state")

    with Punctual(PATIENCE) as punctual:
        punctual.later(wrong)
        with pytest.raises(ValueError, match="no such state"):
            punctual.finish()
        punctual.finish()


def test_what_went_wrong_before_comes_out_where_a_result_is_waited_for() -> None:
    def wrong() -> None:
        raise ValueError("no such state")

    with Punctual(PATIENCE) as punctual:
        gate = threading.Event()
        punctual.later(lambda: gate.wait(PATIENCE))
        punctual.later(wrong)
        threading.Timer(0.01, gate.set).start()
        with pytest.raises(ValueError, match="no such state"):
            punctual.in_time(lambda: 1)


def test_work_hands_over_no_work() -> None:
    """It would wait for itself."""
    with Punctual(PATIENCE) as punctual:
        for wrong in (lambda: punctual.later(int), lambda: punctual.in_time(int), punctual.finish):
            punctual.later(wrong)
            with pytest.raises(AssertionError, match=r"work (hands over|waits for) no work"):
                punctual.finish()


def test_however_threads_take_turns_everything_is_done_in_order(hectic: None) -> None:
    """Ten thousand pieces, a tenth of them waited for; it hangs or miscounts if they meet."""
    done: list[int] = []

    def piece(number: int) -> int:
        done.append(number)
        return len(done)

    with Punctual(PATIENCE) as punctual:
        for first in range(0, 10_000, 10):
            for number in range(first, first + 9):
                punctual.later(partial(piece, number))
            assert punctual.in_time(partial(piece, first + 9)) == first + 10
            punctual.finish()
    assert done == list(range(10_000))


def test_a_closed_one_leaves_no_thread_and_does_nothing_more() -> None:
    before, signal = threading.active_count(), threading.Event()
    done: list[str] = []
    with Punctual(PATIENCE) as punctual:
        assert threading.active_count() == before
        punctual.later(lambda: signal.wait(PATIENCE))
        left = punctual.later(lambda: done.append("too late"))
        assert threading.active_count() == before + 1
        timer = threading.Timer(0.01, signal.set)
        timer.start()
    timer.join()
    assert left.cancelled()
    assert threading.active_count() == before
    assert done == []
