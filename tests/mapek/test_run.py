"""Whole runs of the loop: recorded, taken up again, and through faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from merap.errors import InputError, StorageError
from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.knowledge.event_log import JsonLines
from merap.mapek import run_store
from merap.mapek.records import EpisodeRow
from merap.mapek.run import run_loop
from merap.mapek.run_store import umb_bytes
from merap.mdp.model import TabularMDP
from merap.runs.run_folder import RunFolder
from merap.systems.interface import ManagedSystem
from merap.systems.retrying import Retries, RetryingSystem
from tests.support.loop_runs import MOVED, Unsound, scenario, timeless
from tests.support.trained_runs import trained

EPISODES = 10
# Everything at once that a run has to come through the same way when it is taken up again.
TROUBLE = "noise: {reward: 0.1, slip: 0.05}\nsensing: {delay: 1, loss: 0.1}\n"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture
def knowledge(knowledge_url: str) -> Iterator[KnowledgeBase]:
    with open_knowledge(knowledge_url) as opened:
        yield opened


class KilledError(Exception):
    """Stands for the end of the process."""


def killed_after(episode: int) -> Callable[[EpisodeRow], None]:
    def stop(row: EpisodeRow) -> None:
        if row.episode == episode:
            raise KilledError

    return stop


def test_a_run_is_recorded_with_all_that_was_seen_and_decided(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    report = run_loop(run, scenario(tmp_path), knowledge=knowledge)
    (recorded,) = knowledge.runs()
    assert (recorded.name, recorded.case, recorded.digest) == ("moved.merap", run.case.name, run.case.digest)
    assert recorded.report is not None
    assert recorded.report["summary"] == report.as_dict()["summary"]
    steps = sum(row.steps for row in report.rows)
    assert len(list(knowledge.observations(1))) == steps + EPISODES
    kinds = [decision.kind for decision in knowledge.decisions(1)]
    assert kinds.count("episode") == EPISODES
    assert kinds.count("replan") == report.as_dict()["summary"]["adaptations"]
    assert all(decision.reasons for decision in knowledge.decisions(1) if decision.kind == "replan")
    policies = knowledge.policies(1)
    assert policies[0].kind == "meta"
    assert len(policies) == 1 + report.as_dict()["summary"]["policy_updates"]
    assert [policy.model for policy in policies if policy.model] == [
        model.id for model in knowledge.models(1)
    ]
    assert any("returned" in event.message for event in knowledge.events(1))


def test_recording_changes_nothing(run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase) -> None:
    found = scenario(tmp_path)
    assert timeless(run_loop(run, found, knowledge=knowledge)) == timeless(run_loop(run, found))


@pytest.mark.slow
def test_a_run_goes_on_as_if_it_had_not_been_killed(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    found = scenario(tmp_path, more=TROUBLE)
    wrap = partial(Unsound, calls=2)
    undisturbed = timeless(run_loop(run, found, wrap=wrap))
    resume = False
    for episode in (0, 6):
        with pytest.raises(KilledError):
            run_loop(
                run, found, knowledge=knowledge, resume=resume, wrap=wrap, on_episode=killed_after(episode)
            )
        resume = True
    before = len(list(knowledge.observations(1)))
    assert timeless(run_loop(run, found, knowledge=knowledge, resume=True, wrap=wrap)) == undisturbed
    assert len(knowledge.runs()) == 1
    assert len(list(knowledge.observations(1))) > before
    # taken up once more, a finished run is reported again and nothing is recorded
    counts = knowledge.counts(1)
    assert timeless(run_loop(run, found, knowledge=knowledge, resume=True, wrap=wrap)) == undisturbed
    assert knowledge.counts(1) == counts


def test_a_run_goes_on_only_as_it_was_begun(run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase) -> None:
    with pytest.raises(InputError, match=r"no run 'moved\.merap' in the knowledge base"):
        run_loop(run, scenario(tmp_path), knowledge=knowledge, resume=True)
    with pytest.raises(KilledError):
        run_loop(run, scenario(tmp_path), knowledge=knowledge, on_episode=killed_after(1))
    other = scenario(tmp_path, MOVED.replace("seed: 0", "seed: 1"))
    with pytest.raises(InputError, match="was begun with another case or other settings"):
        run_loop(run, other, knowledge=knowledge, resume=True)
    with pytest.raises(InputError, match="no knowledge base to go on from"):
        run_loop(run, scenario(tmp_path), resume=True)


def test_a_run_that_would_go_differently_is_not_gone_on_with(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    """The same name and settings, but the records are those of a manager that acts at random."""
    found = scenario(tmp_path)
    with pytest.raises(KilledError):
        run_loop(run, found, manager="random", knowledge=knowledge, on_episode=killed_after(1))
    recorded = knowledge.run(1)
    settings = {**recorded.settings, "manager": "merap"}
    forged = knowledge.start_run("moved.merap", recorded.case, recorded.digest, settings)
    knowledge.record_observations(forged, list(knowledge.observations(1)))
    for decision in knowledge.decisions(1):
        knowledge.record_decision(forged, decision)
    checkpoint = knowledge.latest_checkpoint(1)
    assert checkpoint is not None
    knowledge.record_checkpoint(forged, checkpoint.episode, checkpoint.state)
    with pytest.raises(
        InputError, match=r"episode 0 went differently when it was recorded, from step \d+ on"
    ):
        run_loop(run, found, knowledge=knowledge, resume=True)


@pytest.mark.slow
def test_a_second_process_that_goes_on_with_a_run_fails_and_spoils_nothing(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase, knowledge_url: str
) -> None:
    """The first is overtaken after its third episode by one that finishes the run."""
    found = scenario(tmp_path)
    undisturbed = timeless(run_loop(run, found))

    def overtaken(row: EpisodeRow) -> None:
        if row.episode == 2:
            with open_knowledge(knowledge_url) as other:
                run_loop(run, found, knowledge=other, resume=True)

    lines = JsonLines(tmp_path / "events.jsonl")
    with pytest.raises(StorageError, match="another process goes on with this run") as late, lines:
        run_loop(run, found, knowledge=knowledge, lines=lines, on_episode=overtaken)
    assert "\n" not in str(late.value)
    # the log tells of what was kept, and of the error
    *told, last = (tmp_path / "events.jsonl").read_text().splitlines()
    assert "episode 2 returned" in told[-1]
    assert "another process goes on with this run" in last
    recorded = [row.episode for row in knowledge.decisions(1) if row.kind == "episode"]
    assert recorded == list(range(EPISODES))
    assert knowledge.counts(1)["checkpoint"] == EPISODES
    assert timeless(run_loop(run, found, knowledge=knowledge, resume=True)) == undisturbed


def test_others_can_write_while_models_are_packed(
    run: RunFolder,
    tmp_path: Path,
    knowledge: KnowledgeBase,
    knowledge_url: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    packed = []

    def beside(model: TabularMDP) -> bytes:
        with open_knowledge(knowledge_url, lock_timeout=0) as other:
            packed.append(other.start_run("beside", "case", "digest", {}))
        return umb_bytes(model)

    monkeypatch.setattr(run_store, "umb_bytes", beside)
    run_loop(run, scenario(tmp_path), knowledge=knowledge)
    assert packed
    assert len(knowledge.models(1)) == len(packed)


def test_a_run_that_two_processes_have_mixed_in_is_not_gone_on_with(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    """As it could be left by a version that did not refuse the second one."""
    found = scenario(tmp_path)
    with pytest.raises(KilledError):
        run_loop(run, found, knowledge=knowledge, on_episode=killed_after(1))
    for decision in list(knowledge.decisions(1)):
        knowledge.record_decision(1, decision)
    with pytest.raises(InputError, match="has the episodes 0, 1, 0, 1, expected each up to 1 once"):
        run_loop(run, found, knowledge=knowledge, resume=True)


def test_faults_are_in_the_report_and_in_the_log(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    report = run_loop(run, scenario(tmp_path), knowledge=knowledge, wrap=partial(Unsound, calls=2))
    assert [row.problems for row in report.rows if row.problems] == [2, 2, 2]
    told = [event for event in knowledge.events(1) if event.level == "warning"]
    assert sum(event.message == "dropped: the connection is lost" for event in told) == 6
    assert all(event.data["episode"] % 3 == 1 for event in told)


def test_an_unknown_manager_begins_nothing(run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase) -> None:
    with pytest.raises(InputError, match="no manager 'reactiv'"):
        run_loop(run, scenario(tmp_path), manager="reactiv", knowledge=knowledge)
    assert knowledge.runs() == ()


def wrapped(system: ManagedSystem) -> ManagedSystem:
    """The call that fails is not made again; the fallback is taken in its place."""
    return RetryingSystem(Unsound(system, calls=1), retries=Retries(count=0), fallback="stop")


@pytest.mark.slow
def test_what_a_guard_has_done_is_recorded_and_repeated(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    found = scenario(tmp_path)
    with pytest.raises(KilledError):
        run_loop(run, found, knowledge=knowledge, wrap=wrapped, on_episode=killed_after(6))
    taken = [one.data["taken"] for one in knowledge.decisions(1) if one.kind == "episode"]
    stop = run.case.actions.index("stop")
    assert [list(each.values()) for each in taken] == [[], [stop], [], [], [stop], [], []]
    report = run_loop(run, found, knowledge=knowledge, resume=True, wrap=wrapped)
    assert timeless(report) == timeless(run_loop(run, found, wrap=wrapped))
    assert not any(row.problems for row in report.rows)
