"""The process behind a `CheckingProcess`: process_main.py FILE_DESCRIPTOR SECONDS.

It ends by itself when its caller is gone, and by the kernel's alarm when a request is over that
time; Storm can't hold either up.
"""

from __future__ import annotations

import signal
import sys
from multiprocessing.connection import Connection

from merap.checker.exchange import Answer, ForeignModel, ModelText
from merap.checker.property_file import Property
from merap.checker.storm import build_foreign, build_weighted
from merap.checker.storm_model import StormModel
from merap.errors import MerapError
from merap.mdp.model import Floats


def _serve(connection: Connection, timeout: float) -> None:
    """Answer requests until the caller is gone."""
    storm: StormModel | None = None
    initial: Floats | None = None
    while True:
        try:
            request = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_REAL, timeout)
        reply: Answer | MerapError | tuple[str, ...] = ()
        try:
            if isinstance(request, ModelText):
                storm, initial = build_weighted(request)
            elif isinstance(request, ForeignModel):
                (storm, reply), initial = build_foreign(request), None
            else:
                assert storm is not None
                assert isinstance(request, Property)
                reply = storm.check_property(request, initial)
        except MerapError as error:
            reply = error
        signal.setitimer(signal.ITIMER_REAL, 0)
        connection.send(reply)


if __name__ == "__main__":
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    _serve(Connection(int(sys.argv[1])), float(sys.argv[2]))
