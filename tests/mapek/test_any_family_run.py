"""The loop on families over which no belief is kept: processes without a space's map, and PRISM text."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.errors import MerapWarning
from merap.families.loading import load_case
from merap.knowledge.base import open_knowledge
from merap.learning.config import TrainingConfig
from merap.mapek.replaying import check_decisions
from merap.mapek.run import run_loop
from merap.mapek.scenario import read_scenario
from merap.runs.run_folder import RunFolder
from merap.runs.train import train
from tests.support.case_examples import write_case
from tests.support.process_cases import SERVICE
from tests.support.small_families import LAMPS, LAMPS_CASE

LEARNING = TrainingConfig(updates=3, hidden=(8,), episodes=5)
BUSY = """\
scenario: busy
system: calm.fast.thrift
episodes: 12
changes: [{at: {episode: 6, step: 4}, environment: {up: 0.6, down: 0}, objective: quality}]
"""
MOVED = """\
scenario: moved
system: met
episodes: 12
noise: {slip: 0.1}
changes: [{at: {episode: 6}, environment: {prize: 2}}]
"""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = tmp_path_factory.mktemp("service")
    return train(load_case(write_case(folder, SERVICE)), folder / "run", LEARNING)


@pytest.fixture(scope="module")
def lamps(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = tmp_path_factory.mktemp("lamps")
    (folder / "lamps.prism").write_text(LAMPS, encoding="utf-8")
    return train(load_case(write_case(folder, LAMPS_CASE)), folder / "run", LEARNING)


@pytest.mark.parametrize("strategy", ["gradient, episodes_per_step: 3", "retrieval", "joint"])
@pytest.mark.parametrize(("family", "text"), [("service", BUSY), ("lamps", MOVED)])
def test_it_adapts_runs_through_a_change_and_repeats(
    family: str, text: str, strategy: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    run: RunFolder = request.getfixturevalue(family)
    more = f"sensing: {{delay: 1, loss: 0.1}}\nstrategy: {{name: {strategy}, updates: 2}}\n"
    (tmp_path / "scenario.yaml").write_text(text + more, encoding="utf-8")
    found = read_scenario(tmp_path / "scenario.yaml")
    with open_knowledge(f"sqlite:///{tmp_path / 'k.db'}") as knowledge:
        with pytest.warns(MerapWarning, match=f"{family}: without a belief no change is noticed"):
            report = run_loop(run, found, knowledge=knowledge)
        assert check_decisions(run, knowledge, 1) == ()
    assert [row.stage for row in report.rows] == [0] * 6 + [1] * 6
    assert sum(row.updates for row in report.rows) == 2
    for row in report.rows:
        assert row.problems == 0
        assert row.optimum is not None
        assert row.expected is not None
        assert row.expected <= row.optimum + 1e-9


@pytest.mark.parametrize("manager", ["none", "random", "static", "reactive"])
def test_simpler_managers_run_too(service: RunFolder, tmp_path: Path, manager: str) -> None:
    (tmp_path / "scenario.yaml").write_text(
        BUSY + "strategy: {name: retrieval}\ntrigger: {kind: none}\n", encoding="utf-8"
    )
    report = run_loop(service, read_scenario(tmp_path / "scenario.yaml"), manager=manager)
    assert len(report.rows) == 12
