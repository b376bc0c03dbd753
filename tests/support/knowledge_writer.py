"""Records steps until it is killed; each is acknowledged on standard output once it is committed.

For each number of a run on standard input a process is forked, since importing takes longer than
what is tested: one that has imported all is a thousand times as fast to have.
"""

from __future__ import annotations

import os
import sys
from itertools import count

from merap.knowledge.base import open_knowledge
from merap.knowledge.rows import DecisionRow, ObservationRow


def state(step: int) -> bytes:
    """What a checkpoint holds."""
    return f"state {step}".encode() * 100


def write_on(url: str, run: int) -> None:
    """Observations, every third step with a decision in one transaction, else followed by a checkpoint."""
    with open_knowledge(url) as knowledge:
        for step in count():
            observation = ObservationRow(0, step, (step,), 0, float(step), 1.0, False)
            if step % 3 == 0:
                with knowledge.transaction():
                    knowledge.record_observations(run, [observation])
                    knowledge.record_decision(run, DecisionRow(0, step, "checked", data={"step": step}))
            else:
                knowledge.record_observations(run, [observation])
                knowledge.record_checkpoint(run, step, state(step))
            tell(f"{step}")


def tell(line: str) -> None:
    os.write(sys.stdout.fileno(), f"{line}\n".encode())  # a short line is written whole


def main(url: str) -> None:
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            write_on(url, int(line))
        tell(f"pid {child}")
        _, status = os.waitpid(child, 0)
        tell(f"exit {os.waitstatus_to_exitcode(status)}")


if __name__ == "__main__":
    main(sys.argv[1])
