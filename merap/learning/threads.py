"""How work is shared among threads: ranges of tasks on a pool, and never a single product.

Products of this size are fastest on one thread: handing work over costs more than the work, and on a busy
machine BLAS threads wait for one another in a loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

import torch
from threadpoolctl import ThreadpoolController

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


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let every product inside use the thread it is called on."""
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


def on_threads(pieces: list[Callable[[], Result]]) -> list[Result]:
    """Do pieces of work on as many threads as torch may use; their results in order."""
    threads = min(torch.get_num_threads(), len(pieces))
    if threads == 1:
        return [piece() for piece in pieces]
    return list(_pool(threads).map(lambda piece: piece(), pieces))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="merap")
