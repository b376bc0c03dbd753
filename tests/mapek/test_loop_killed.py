"""A run that is killed ten times at random moments ends as one that was left alone."""

from __future__ import annotations

import multiprocessing
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from merap.knowledge.base import open_knowledge
from merap.mapek.run import run_loop
from merap.mapek.scenario import Scenario
from merap.runs.run_folder import RunFolder
from tests.support.loop_child import go
from tests.support.loop_runs import scenario, timeless
from tests.support.trained_runs import trained

pytestmark = pytest.mark.process

KILLS = 10
SCENARIO = """\
scenario: killed
system: met
episodes: 60
seed: 3
changes:
  - {at: {episode: 12}, capability: {no_entry: [[4, 3], [3, 4], [2, 2]]}}
  - {at: {episode: 25, step: 4}, objective: {goal: [3, 2]}}
noise: {reward: 0.1, slip: 0.05}
sensing: {loss: 0.05}
strategy: {name: gradient, episodes_per_step: 3, updates: 4}
"""
# A process that begins has to load what it needs; it may do so on a busy machine.
PATIENCE = 120.0


def killed(run: RunFolder, url: str, done: int, generator: np.random.Generator) -> int:
    """Let it run for some more episodes and kill it; how many were done then at least."""
    context = multiprocessing.get_context("forkserver")
    receiver, sender = context.Pipe(duplex=False)
    file = run.path.parent / "scenario.yaml"
    process = context.Process(target=go, args=(run.path, file, url, done > 0, sender))
    process.start()
    sender.close()
    target = done + int(generator.integers(1, 5))
    while done < target:
        assert receiver.poll(PATIENCE)
        done = max(done, receiver.recv() + 1)
    time.sleep(float(generator.uniform(0, 0.05)))
    assert process.is_alive()
    process.kill()
    process.join(PATIENCE)
    assert process.exitcode == -signal.SIGKILL
    return done


def committed(url: str) -> list[int]:
    with open_knowledge(url) as knowledge:
        return [one.episode for one in knowledge.decisions(1) if one.kind == "episode"]


@pytest.mark.slow
def test_killed_ten_times_at_random(knowledge_url: str, tmp_path: Path) -> None:
    run = trained(tmp_path / "run")
    found: Scenario = scenario(tmp_path, SCENARIO)
    multiprocessing.get_context("forkserver").set_forkserver_preload(["merap.mapek.run", "torch._dynamo"])
    generator = np.random.default_rng()
    done = 0
    for _ in range(KILLS):
        done = killed(run, knowledge_url, done, generator)
        # what was reported done is there, in order and once
        kept = committed(knowledge_url)
        assert kept == list(range(len(kept)))
        assert len(kept) >= done
        done = len(kept)
    assert done < found.spec.episodes
    with open_knowledge(knowledge_url) as knowledge:
        report = run_loop(run, found, knowledge=knowledge, resume=True)
        assert len(knowledge.runs()) == 1
    assert timeless(report) == timeless(run_loop(run, found))
