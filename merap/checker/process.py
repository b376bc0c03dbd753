"""Have models checked by a process that a time limit can end.

Storm holds the interpreter until it has an answer, and where its own alarm interrupts it, it
returns a partial value as final. So one process, `process_main`, builds and checks the models
of a whole run. The kernel's alarm ends it when a property is over its time; the next property
gets a new process.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from multiprocessing.connection import Pipe
from pathlib import Path
from types import TracebackType
from typing import Any

from merap.checker.exchange import Answer, ForeignModel, ModelText
from merap.checker.property_file import Property, read_property
from merap.concerns.arguments import as_number
from merap.errors import EngineError, InputError, MerapError

LONGEST = 1e8  # seconds
MAIN = "merap.checker.process_main"


class OverTimeError(EngineError):
    """The engine had no answer within its time limit."""


class CheckingProcess:
    """A process that builds one model after the other and checks its properties.

    Args:
        timeout: seconds for building a model, and for each property.

    Raises:
        InputError: no such limit is possible.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = as_number(timeout, "timeout")
        if not 0 < self._timeout <= LONGEST:
            raise InputError(f"timeout {timeout}: expected seconds above 0, at most {LONGEST:g}")
        self._model: ModelText | ForeignModel | None = None
        self._notes: tuple[str, ...] = ()
        self._building = False
        self._start()

    def __enter__(self) -> CheckingProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._end()

    def begin(self, model: ModelText | ForeignModel) -> None:
        """Begin to build the model that the coming properties are of, and do not wait for it."""
        self._model = model
        self._building = True
        self._send(model)

    def finish(self) -> tuple[str, ...]:
        """Wait until the model is built; return what is to be said about it.

        Raises:
            InputError: its text is wrong.
            ModelError: it is unsound.
            OverTimeError: it is not built in time.
            EngineError: Storm failed, or its process died.
        """
        assert self._model is not None
        if self._building:
            self._building = False
            self._notes = self._receive(f"{self._model.name}: building the model")
        return self._notes

    def check(self, given: str | Property) -> Answer:
        """Check a property of the model, which is built first where it isn't.

        Raises:
            InputError: the property can't be parsed or names something unknown.
            UnsupportedPropertyError: Storm can't answer this kind, or not soundly.
            OverTimeError: it has no answer in time.
            EngineError: Storm failed, or its process died.
        """
        assert self._model is not None
        if self._process.poll() is not None:
            self.begin(self._model)
        self.finish()
        if isinstance(given, str):
            given = read_property(given, self._model.name)
        self._send(given)
        answer = self._receive(f"{self._model.name}: property {given.text!r}")
        assert isinstance(answer, Answer)
        return answer

    def _send(self, request: ModelText | ForeignModel | Property) -> None:
        if self._process.poll() is not None:
            self._end()
            self._start()
        try:
            self._connection.send(request)
        except ConnectionError:
            return  # it died since; receiving says how

    def _receive(self, place: str) -> Any:
        try:
            reply = self._connection.recv()
        except (EOFError, ConnectionError) as error:
            raise self._ended(place) from error
        if isinstance(reply, MerapError):
            raise reply
        return reply

    def _ended(self, place: str) -> EngineError:
        """Build the error to raise where the process ended before it replied."""
        code = self._process.wait()
        if code == -signal.SIGALRM:
            return OverTimeError(f"{place}: not done within {self._timeout:g} s")
        reason = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return EngineError(f"{place}: Storm's process died ({reason})")

    def _start(self) -> None:
        self._connection, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", MAIN, str(theirs.fileno()), str(self._timeout)],
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path),
                },
                pass_fds=[theirs.fileno()],
                process_group=0,  # Ctrl-C is the caller's
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )

    def _end(self) -> None:
        self._connection.close()
        self._process.kill()
        self._process.wait()
