"""The process behind a `CheckingProcess`: process_main.py FILE_DESCRIPTOR SECONDS.

It ends by itself when its caller is gone, and by the kernel's alarm when a request is over that
time; Storm can't hold either up.
"""

from __future__ import annotations

import signal
import sys
from multiprocessing.connection import Connection

from merap.checker.exchange import Answer, ModelText
from merap.checker.storm import StormModel, build_weighted
from merap.errors import MerapError
from merap.mdp.model import Floats


def _serve(connection: Connection, timeout: float) -> None:
    """Answer requests until the caller is gone."""
    built: tuple[StormModel, Floats] | None = None
    while True:
        try:
            request = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_REAL, timeout)
        reply: Answer | MerapError | None = None
        try:
            if isinstance(request, ModelText):
                built = build_weighted(request)
            else:
                assert built is not None
                storm, initial = built
                reply = storm.check(request, initial)
        except MerapError as error:
            reply = error
        signal.setitimer(signal.ITIMER_REAL, 0)
        connection.send(reply)


if __name__ == "__main__":
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    _serve(Connection(int(sys.argv[1])), float(sys.argv[2]))
