"""A run of the loop in a process of its own, which tells its parent of every episode, to be killed."""

from __future__ import annotations

from multiprocessing.connection import Connection
from pathlib import Path

from merap.knowledge.base import open_knowledge
from merap.mapek.run import run_loop
from merap.mapek.scenario import read_scenario
from merap.runs.run_folder import read_run


def go(run: Path, scenario: Path, url: str, resume: bool, parent: Connection) -> None:
    """Run, or go on; send the number of each episode."""
    with open_knowledge(url) as knowledge:
        run_loop(
            read_run(run),
            read_scenario(scenario),
            knowledge=knowledge,
            resume=resume,
            on_episode=lambda row: parent.send(row.episode),
        )
