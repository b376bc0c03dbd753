"""End to end: a served running example, managed through HTTP by strategies and the whole loop."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import numpy as np
import pytest

from merap.belief.space import hypothesis_space
from merap.belief.strategy import BeliefStrategy
from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from merap.families.models import built
from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.knowledge.event_log import JsonLines
from merap.learning.config import TrainingConfig
from merap.mapek.records import EpisodeRow
from merap.mapek.replaying import check_decisions
from merap.mapek.run import GONE, run_loop
from merap.mapek.scenario import Scenario
from merap.mapek.serving import served_scenario
from merap.mdp.planning import optimum
from merap.report.timeline import draw_timeline
from merap.runs.run_folder import RunFolder
from merap.strategies.evaluation import evaluator
from merap.strategies.protocol import episode
from merap.systems.interface import SystemFault
from merap.systems.retrying import Retries, RetryingSystem
from merap.systems.served_dialect import open_served
from tests.support.hand_made import grid_combination
from tests.support.http_servers import FlakyServer, Mishap, free_port, raw_server, served_system, serving
from tests.support.loop_runs import scenario
from tests.support.placed import index_of
from tests.support.trained_runs import trained

RUNNING = Path("models/running-example")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    config = TrainingConfig(updates=2, hidden=(4,), episodes=2)
    return trained(tmp_path_factory.mktemp("runs") / "run", config, RUNNING)


@pytest.fixture
def knowledge(knowledge_url: str) -> Iterator[KnowledgeBase]:
    with open_knowledge(knowledge_url) as opened:
        yield opened


def test_a_belief_adapts_through_http_over_a_bad_connection() -> None:
    """A blocked at A, which no model has: after at most 6 episodes within 5 % of the optimum.

    Every tenth request meets with a mishap; with these seeds nothing is left to chance.
    """
    case = load_declared_case(RUNNING)
    met = case.system("met")
    kinds: list[Mishap] = ["none", "lost", "answer lost", "failed", "rubbish"]
    drawn = np.random.default_rng(0).choice(5, 10_000, p=[0.9, *[0.025] * 4])
    server = FlakyServer(served_system(met, seed=1, detect=True), iter(()))
    index = index_of([met])
    space = hypothesis_space(case, index=index)
    strategy = BeliefStrategy(space, 40, np.random.default_rng(2))
    model = index.place(built(met))
    with (
        raw_server(server) as url,
        open_served(url, timeout=10, actions=case.actions, variables=space.states.variable_names) as remote,
    ):
        assert remote.interface.horizon == 40
        server.mishaps = (kinds[index] for index in drawn)
        system = RetryingSystem(remote, retries=Retries(10, 0.0, 0.0))
        for _ in range(6):
            episode(system, strategy)
            strategy.update()
    best = optimum(model, 40)
    assert best - evaluator(model, 40)(strategy.policy()) <= 0.05 * abs(best)


def elsewhere(folder: Path, url: str, more: str = "", episodes: int = 2) -> Scenario:
    system = f'system: {{url: "{url}", timeout: 30, retries: 1}}'
    return scenario(folder, f"scenario: elsewhere\n{system}\nepisodes: {episodes}\n", more)


@pytest.mark.parametrize("strategy", ["belief", "gradient"])
def test_the_loop_manages_a_served_system_by_any_strategy(
    run: RunFolder, tmp_path: Path, strategy: str
) -> None:
    more = (
        f"strategy: {{name: {strategy}, episodes_per_step: 2}}\ndeadline: {{seconds: 60, fallback: stop}}\n"
    )
    with serving(run.case.system("met"), detect=True) as url:
        report = run_loop(run, elsewhere(tmp_path, url, more))
    assert report.ended_by is None
    assert [row.episode for row in report.rows] == [0, 1]
    assert all(0 < row.steps <= 40 for row in report.rows)
    for row in report.rows:
        assert (row.optimum, row.expected, row.entered, row.safe_optimum, row.unsafe) == (None,) * 5
    summary = report.as_dict()["summary"]
    assert (summary["regret"], summary["mean_optimum"], summary["violations"]) == (None, None, None)
    assert summary["faults"] == {}
    draw_timeline(report)


def test_faults_that_were_mended_are_counted(run: RunFolder, tmp_path: Path) -> None:
    server = FlakyServer(served_system(run.case.system("met"), detect=True), iter(()))
    first: list[Mishap] = ["none"] * 40
    first[20], first[30] = "failed", "rubbish"
    with raw_server(server) as url:
        found = elsewhere(tmp_path, url, "strategy: {name: retrieval}\n", episodes=1)
        server.mishaps = iter(first)
        report = run_loop(run, found)
    assert report.rows[0].faults == {"failed": 1, "malformed": 1}
    assert report.rows[0].problems == 0


def test_a_system_that_is_not_there_begins_nothing(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    nobody = elsewhere(tmp_path, f"http://127.0.0.1:{free_port()}")
    with pytest.raises(SystemFault, match="refused: http://127"):
        run_loop(run, nobody, knowledge=knowledge)
    assert list(knowledge.runs()) == []


@pytest.mark.slow
def test_a_system_that_goes_away_is_waited_for_and_gone_on_with(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    """After the first episode every request fails; three resets in vain later the run ends, and is taken up
    again when the system is back. What was decided before is decided again from the records alone."""
    server = FlakyServer(served_system(run.case.system("met"), detect=True), iter(()))

    def fail_from_now_on(row: EpisodeRow) -> None:
        server.mishaps = repeat("failed")

    with raw_server(server) as url:
        found = elsewhere(tmp_path, url, "strategy: {name: retrieval}\n", episodes=6)
        with JsonLines(tmp_path / "events.jsonl") as lines:
            report = run_loop(run, found, knowledge=knowledge, lines=lines, on_episode=fail_from_now_on)
        assert len(report.rows) == 1 + GONE
        assert [row.steps > 0 for row in report.rows] == [True, False, False, False]
        assert report.rows[1].faults == {"failed": 2}
        assert str(report.ended_by).startswith("gone: none of the last 3 episodes could begin, ")
        assert report.as_dict()["ended_by"] == str(report.ended_by)
        assert "gone: none of the last 3" in (tmp_path / "events.jsonl").read_text().splitlines()[-1]
        (recorded,) = knowledge.runs()
        assert recorded.finished is None
        server.mishaps = iter(())
        again = run_loop(run, found, knowledge=knowledge, resume=True)
    assert again.ended_by is None
    assert again.rows[: 1 + GONE] == report.rows
    assert [row.steps > 0 for row in again.rows[1 + GONE :]] == [True, True]
    assert check_decisions(run, knowledge, recorded.id) == ()
    # all is over: nobody is asked any more
    assert run_loop(run, found, knowledge=knowledge, resume=True).rows == again.rows


def test_a_system_of_another_case_is_refused(run: RunFolder, tmp_path: Path) -> None:
    with (
        serving(grid_combination()) as url,
        pytest.raises(InputError, match=r"scenario\.yaml:2: system: .* has the actions stop"),
    ):
        run_loop(run, elsewhere(tmp_path, url))


def test_a_system_with_another_horizon_is_refused_until_it_is_said(run: RunFolder, tmp_path: Path) -> None:
    met = run.case.system("met")
    brief = replace(met, objective=replace(met.objective, horizon=7))
    with serving(brief) as url:
        with pytest.raises(InputError, match="an episode of it has 7 steps, not 40; say so by horizon"):
            run_loop(run, elsewhere(tmp_path, url))
        said = scenario(tmp_path, f'scenario: brief\nsystem: {{url: "{url}", horizon: 7}}\nepisodes: 2\n')
        assert all(row.steps <= 7 for row in run_loop(run, said).rows)


def test_the_oracle_has_no_model_here(run: RunFolder, tmp_path: Path) -> None:
    with serving(run.case.system("met")) as url, pytest.raises(InputError, match="needs the true model"):
        run_loop(run, elsewhere(tmp_path, url, "strategy: {name: oracle}\n"))


@pytest.mark.parametrize(
    ("more", "place"),
    [
        ("changes: [{at: {episode: 1}, objective: g1}]", "changes"),
        ("noise: {slip: 0.1}", "noise.slip"),
        ("reset: none", "reset"),
    ],
)
def test_what_is_up_to_the_system_can_not_be_asked_for(tmp_path: Path, more: str, place: str) -> None:
    message = re.escape(f"scenario.yaml:4: {place}: the system is not simulated")
    with pytest.raises(InputError, match=message):
        elsewhere(tmp_path, "http://localhost:1", more + "\n")


def test_what_is_not_simulated_can_not_be_served(run: RunFolder, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"scenario\.yaml:2: system: the system is not simulated"):
        served_scenario(run.case, elsewhere(tmp_path, "http://localhost:1"))
