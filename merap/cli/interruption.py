"""End a process when it is interrupted: exit code 130 and one line, nothing half-written, never a traceback.

An exception that a signal handler raises can surface anywhere: inside an import, a compiler's callback or a
library that turns it into another error. So none is raised. A thread waits for the signal, which is passed
on even while the main thread is inside compiled code, waits for a file that is being put in place, removes
what is unfinished and ends the process.

Z3, which Storm calls while it builds a model, takes SIGINT for itself and goes on with a wrong answer. So
SIGINT is blocked, which leaves it to a second thread that takes it whatever its handler is. Children inherit
the block; they are ended with the process.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from merap.masking import masked

INTERRUPTED = 130
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_TAKEN_BY_LIBRARIES = frozenset({signal.SIGINT})
# Moves the cursor to the begin of a line that a progress bar may have left, clears it, shows the cursor.
_CLEAR_LINE = b"\r\x1b[2K\x1b[?25h"


@dataclass
class _WayOn:
    """The command that goes on after an interruption, and whether there is something to go on with."""

    command: str = ""
    exists: Callable[[], bool] = lambda: False


@dataclass
class _Reaction:
    """What an interruption calls."""

    call: Callable[[], None]


_way_on = _WayOn()
_ending = threading.Event()


def go_on_with(command: str, when: Callable[[], bool]) -> None:
    """Set the command that an interrupted user is told to go on with.

    Args:
        command: as it is typed.
        when: whether there is something to go on with yet; asked when the signal arrives.
    """
    _way_on.command, _way_on.exists = command, when


def interrupted_line() -> str:
    """Return the one line that an interrupted user reads."""
    if _way_on.exists():
        return f"interrupted; go on with: {masked(_way_on.command)}"
    return "interrupted"


@contextmanager
def interruptible(*, last: bool = False) -> Iterator[None]:
    """End the process with exit code 130 when a signal interrupts it inside.

    Signals that the caller ignores, as a shell does for a job in the background, stay ignored. Outside
    the main thread, which alone may handle signals, nothing changes.

    Args:
        last: nothing is left to do afterwards, so that signals are ignored from then on.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    go_on_with("", lambda: False)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    watched = [number for number in _SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    with _taking(_TAKEN_BY_LIBRARIES.intersection(watched)):
        waiting = (reader, frozenset(watched))
        threading.Thread(target=_wait, args=waiting, name="interruption", daemon=True).start()
        before = {number: signal.signal(number, _note) for number in watched}
        woken = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, signal.SIG_IGN if last else handler)
            signal.set_wakeup_fd(woken)
            os.close(writer)
            if _ending.is_set():  # an error of the last moment is not told
                _end()


@contextmanager
def interruption_calls(end: Callable[[], None]) -> Iterator[None]:
    """Let an interruption call a function inside, such as one that ends a server, and nothing else."""
    numbers = [number for number in _SIGNALS if signal.getsignal(number) is _note]
    woken = signal.set_wakeup_fd(-1)
    before, _reaction.call = _reaction.call, end
    for number in numbers:
        signal.signal(number, lambda number, frame: end())
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, _note)
        _reaction.call = before
        signal.set_wakeup_fd(woken)


@contextmanager
def _taking(numbers: frozenset[signal.Signals]) -> Iterator[None]:
    """Block signals inside, also in threads that are started there; one reacts whatever the handlers are."""
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    over, woken = threading.Event(), threading.Event()
    taker = threading.Thread(target=_take, args=(numbers, over, woken), name="taking signals", daemon=True)
    taker.start()
    try:
        yield
    finally:
        over.set()
        for number in numbers:
            signal.pthread_kill(taker.ident or 0, number)
        woken.set()
        taker.join()
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _take(numbers: frozenset[signal.Signals], over: threading.Event, woken: threading.Event) -> None:
    """React to each signal until it is over; the last one only wakes this thread, which waits for it."""
    while numbers:
        signal.sigwait(numbers)
        if over.is_set():
            woken.wait()
            return
        _reaction.call()


def _note(number: int, frame: object) -> None:
    """Let the main thread end the process too, should it get there before the thread that waits."""
    _ending.set()


def _wait(reader: int, watched: frozenset[int]) -> None:
    """Wait for a signal, or for the end of `interruptible`."""
    while (received := os.read(reader, 1)) and received[0] not in watched:
        pass
    if received:
        _end()
    os.close(reader)


def _interrupt() -> None:
    """End the process, in the main thread too should it get there before."""
    _ending.set()
    _end()


_reaction = _Reaction(_interrupt)


def _end() -> None:
    from merap.families.folder import discard_unfinished

    with discard_unfinished():
        _end_children()
        line = f"{interrupted_line()}\n".encode(errors="surrogateescape")
        with suppress(OSError):  # nobody may be reading
            os.write(2, (_CLEAR_LINE if os.isatty(2) else b"") + line)
        os._exit(INTERRUPTED)


def _end_children() -> None:
    """End the processes that this one has started and that still run."""
    for task in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # a thread, or a child, may just have ended
            for child in (task / "children").read_text().split():
                os.kill(int(child), signal.SIGKILL)
