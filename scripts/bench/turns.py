"""Time updates of two versions of merap in turns: python scripts/bench/turns.py OTHER [--rounds n].

OTHER is the root of another checkout. A process of each version waits, and both make some updates in each
round; what the machine does besides then slows both alike. Ratios are this version's median over the other's.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

ROOT = Path(__file__).parents[2]
ESTIMATORS = {"exact": 20, "sampled": 5}  # updates of a round

# Runs in either version.
WORKER = """
import sys
from pathlib import Path
from merap.families.build import build_base
try:
    from merap.families.loading import load_case
except ModuleNotFoundError:  # before there were cases as PRISM text
    from merap.concerns.case_study import load_case
from merap.learning.config import TrainingConfig
from merap.learning.tasks import task_batch
from merap.learning.training import initial_state, policy_network, updates

base = build_base(load_case(Path(sys.argv[1])))
tasks = task_batch(base.models, getattr(base, "horizons", None) or base.horizon, base.discount)
rows = {}
for estimator in ("exact", "sampled"):
    config = TrainingConfig(estimator=estimator, updates=10**9)
    rows[estimator] = updates(tasks, config, initial_state(policy_network(tasks, config), config))
    for _ in range(3):
        next(rows[estimator])
for line in sys.stdin:
    estimator, count = line.split()
    print(*(next(rows[estimator]).seconds for _ in range(int(count))), flush=True)
"""


class Worker:
    """A process of one version."""

    def __init__(self, root: Path, case: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", WORKER, str(case)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=root,
            env={**os.environ, "PYTHONPATH": str(root)},
        )

    def seconds(self, estimator: str, count: int) -> list[float]:
        """Return the seconds of updates."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{estimator} {count}\n")
        self._process.stdin.flush()
        return [float(word) for word in self._process.stdout.readline().split()]

    def end(self) -> None:
        self._process.communicate()


def main(
    other: Annotated[Path, typer.Argument(help="Root of the other checkout.")],
    rounds: int = 30,
    case: Path = ROOT / "models" / "paper-grid" / "rq1-1.yaml",
) -> None:
    """Print medians in milliseconds, and their ratio."""
    workers = [Worker(root.resolve(), case.resolve()) for root in (ROOT, other)]
    seconds: dict[str, list[list[float]]] = {estimator: [[], []] for estimator in ESTIMATORS}
    for _ in range(rounds):
        for estimator, count in ESTIMATORS.items():
            for worker, row in zip(workers, seconds[estimator], strict=True):
                row.extend(worker.seconds(estimator, count))
    for worker in workers:
        worker.end()
    for estimator, rows in seconds.items():
        mine, others = (1e3 * statistics.median(row) for row in rows)
        print(f"{estimator}: {mine:.2f} ms against {others:.2f} ms, ratio {mine / others:.2f}")


if __name__ == "__main__":
    typer.run(main)
