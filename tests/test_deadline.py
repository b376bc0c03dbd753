from __future__ import annotations

import threading

import pytest

from merap.online.managed.deadline import Punctual

PATIENCE = 60.0


def test_without_a_limit_work_is_done_at_once() -> None:
    done: list[str] = []
    punctual = Punctual[str](None)
    punctual.later(lambda: done.append("first"))
    assert punctual.in_time(lambda: "second") == "second"
    assert done == ["first"]


def test_work_in_time_has_its_result() -> None:
    punctual = Punctual[int](PATIENCE)
    assert punctual.in_time(lambda: 6 * 7) == 42


def test_late_work_is_finished_before_the_next_piece() -> None:
    """The first piece waits for a signal that is given after it was found late."""
    done: list[str] = []
    signal = threading.Event()

    def slow() -> str:
        assert signal.wait(PATIENCE)
        done.append("slow")
        return "too late"

    punctual = Punctual[str](0.01)
    assert punctual.in_time(slow) is None
    punctual.later(lambda: done.append("next"))
    assert done == []
    signal.set()
    punctual.finish()
    assert done == ["slow", "next"]


def test_while_patient_nothing_is_late() -> None:
    started = threading.Event()

    def slow() -> int:
        started.wait(0.05)
        return 1

    punctual = Punctual[int](0.001)
    punctual.patient = True
    assert punctual.in_time(slow) == 1


def test_what_goes_wrong_beside_the_loop_comes_out_at_its_end() -> None:
    def wrong() -> None:
        raise ValueError("no such state")

    punctual = Punctual[int](PATIENCE)
    punctual.later(wrong)
    with pytest.raises(ValueError, match="no such state"):
        punctual.finish()
    punctual.finish()


def test_what_is_late_can_be_waited_for() -> None:
    signal = threading.Event()

    def slow() -> int:
        assert signal.wait(PATIENCE)
        return 5

    punctual = Punctual[int](0.01)
    assert punctual.in_time(slow) is None
    signal.set()
    assert punctual.late_result() == 5


@pytest.mark.parametrize("limit", [None, PATIENCE])
def test_a_result_comes_after_all_that_was_handed_over_before(limit: float | None) -> None:
    done: list[str] = []
    punctual = Punctual[int](limit)
    punctual.later(lambda: done.append("first"))
    assert punctual.result(lambda: [*done, "second"]) == ["first", "second"]
