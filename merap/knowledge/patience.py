"""Waiting for a lock that another process holds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from merap.errors import StorageError
from merap.knowledge.faults import LockedError

Result = TypeVar("Result")


@dataclass(frozen=True)
class Patience:
    """How long to wait, in seconds.

    Attributes:
        limit: in all, after which it is an error.
        pause: before the second try; doubled with each further one.
        longest: of the pauses.
    """

    limit: float = 30.0
    pause: float = 0.05
    longest: float = 1.0


def patiently(
    attempt: Callable[[], Result], patience: Patience, notice: Callable[[str], None], place: str
) -> Result:
    """The result of an attempt, tried again while another process holds the lock.

    Args:
        attempt: leaves nothing behind when it raises LockedError.
        patience: how long.
        notice: is told when waiting begins, and when it was worth it.
        place: of the knowledge base.

    Raises:
        StorageError: still locked after all.
    """
    began, pause, waiting = time.monotonic(), patience.pause, False
    while True:
        try:
            result = attempt()
        except LockedError as error:
            waited = time.monotonic() - began
            if waited >= patience.limit:
                raise StorageError(f"{error}; gave up after {waited:.1f} s") from error
            if not waiting:
                notice(f"{error}; trying again for {patience.limit:g} s")
            waiting = True
            time.sleep(pause)
            pause = min(2 * pause, patience.longest)
        else:
            if waiting:
                notice(f"{place}: is free again after {time.monotonic() - began:.1f} s")
            return result
