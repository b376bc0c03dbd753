"""`python -m merap`, and the command `merap`: a process of its own."""

import os
import signal


def main() -> None:
    """Run the command line, and nothing after it; an interruption ends it from the first line on."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)
    from merap.cli.main import main as run  # noqa: PLC0415  after the signals are watched

    run(last=True)


def _end(number: int, frame: object) -> None:
    """End the process while nothing but imports has been done."""
    os.write(2, b"interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    main()
