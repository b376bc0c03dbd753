"""The entry point of `merap`: watch for interruptions before anything slow is imported."""

from __future__ import annotations

import sys

from merap.cli.interruption import interruptible
from merap.errors import MerapError


def main(*, last: bool = False) -> None:
    """Run the command line; exit 0 when fine, 1 on a false verdict, 2 on wrong input, 3 if an engine failed.

    An interruption exits with 130.

    Args:
        last: the process has nothing else to do; see `interruptible`.
    """
    try:
        with interruptible(last=last):
            from merap.cli.app import run

            code = run()
    except MerapError as error:
        from merap.cli.output import complain

        complain(str(error))
        code = error.exit_code
    sys.exit(code)
