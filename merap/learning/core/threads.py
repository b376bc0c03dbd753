"""Pieces of work side by side on threads; nothing in the core holds the GIL for long."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Result = TypeVar("Result")


def on_threads(pieces: Sequence[Callable[[], Result]], threads: int) -> list[Result]:
    """Do pieces of work on so many threads at most, the caller's among them; their results in order.

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
