"""Work on threads: everything once, in order, whatever the number of threads."""

from __future__ import annotations

import threading
from functools import partial

import pytest
import torch

from merap.learning.threads import on_threads, one_thread


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
def test_results_come_in_the_order_of_the_pieces(threads: int) -> None:
    done: list[int] = []

    def piece(number: int) -> int:
        done.append(number)
        return number * number

    pieces = [partial(piece, number) for number in range(7)]
    assert on_threads(pieces, threads) == [number * number for number in range(7)]
    assert sorted(done) == list(range(7))


def test_pieces_run_side_by_side() -> None:
    meeting = threading.Barrier(2, timeout=30)  # broken, an error, unless both are in it at once
    assert sorted(on_threads([meeting.wait, meeting.wait], 2)) == [0, 1]


def test_one_thread_is_the_callers() -> None:
    assert set(on_threads([threading.get_ident] * 3, 1)) == {threading.get_ident()}


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_of_a_piece_is_raised(threads: int) -> None:
    def fails() -> int:
        raise ArithmeticError("of the piece")

    with pytest.raises(ArithmeticError, match="of the piece"):
        on_threads([fails, lambda: 1], threads)
    with pytest.raises(ArithmeticError, match="of the piece"):
        on_threads([lambda: 1, fails], threads)


def test_one_thread_is_for_a_while() -> None:
    def divide() -> None:
        with one_thread():
            inside.append(torch.get_num_threads())
            raise ZeroDivisionError

    inside: list[int] = []
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with pytest.raises(ZeroDivisionError):
            divide()
        assert (inside, torch.get_num_threads()) == ([1], 2)
    finally:
        torch.set_num_threads(before)
