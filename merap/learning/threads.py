"""How many threads the learner works on.

Products of its size are fastest on one thread: handing work over costs more than the work, and on a busy
machine threads wait for one another in a loop. Where there is much work, whole ranges of tasks are shared
among threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

import torch

Result = TypeVar("Result")


@contextmanager
def one_thread() -> Iterator[None]:
    """Let torch, and the learner, which asks it, use one thread inside."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def on_threads(pieces: Sequence[Callable[[], Result]], threads: int) -> list[Result]:
    """Do pieces of work on at most this many threads, the caller's among them; return the results in order.

    The caller begins with the last piece, and goes on with those that no other thread has begun.
    """
    others = min(threads, len(pieces)) - 1
    if others < 1:
        return [piece() for piece in pieces]
    futures = [_pool(others).submit(piece) for piece in pieces[:-1]]
    results = [pieces[-1]()]
    for piece, future in zip(reversed(pieces[:-1]), reversed(futures), strict=True):
        results.append(piece() if future.cancel() else future.result())
    return results[::-1]


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="merap")
