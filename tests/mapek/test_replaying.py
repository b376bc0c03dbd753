"""A recorded run of the loop, decided once more from what was observed."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

from merap.errors import InputError
from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.knowledge.engine import default_url
from merap.knowledge.event_log import FILE_NAME, JsonLines
from merap.knowledge.export import event_record
from merap.knowledge.rows import DecisionRow
from merap.mapek.replaying import check_decisions
from merap.mapek.run import run_loop
from merap.runs.run_folder import RunFolder
from tests.support.command_line import CommandLine
from tests.support.loop_runs import MOVED, scenario
from tests.support.trained_runs import trained

TROUBLE = "noise: {reward: 0.1, slip: 0.05}\nsensing: {delay: 1, loss: 0.1}\n"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture(scope="module")
def knowledge(run: RunFolder) -> Iterator[KnowledgeBase]:
    """In the folder of the training run, with one run of the loop."""
    folder, lines = run.path, JsonLines(run.path / FILE_NAME)
    with lines, open_knowledge(default_url(folder), notice=lines.notice) as opened:
        found = scenario(folder, MOVED.replace("episodes: 10", "episodes: 7"), TROUBLE)
        run_loop(run, found, knowledge=opened, lines=lines)
        yield opened


def forged(knowledge: KnowledgeBase, extra: DecisionRow | None = None, **settings: object) -> int:
    """The same run once more, with a decision in front or other settings."""
    row = knowledge.run(1)
    number = knowledge.start_run(row.name, row.case, row.digest, {**row.settings, **settings})
    knowledge.record_observations(number, [*knowledge.observations(1)])
    for decision in ([] if extra is None else [extra], knowledge.decisions(1)):
        for one in decision:
            knowledge.record_decision(number, one)
    checkpoint = knowledge.latest_checkpoint(1)
    assert checkpoint is not None
    knowledge.record_checkpoint(number, checkpoint.episode, checkpoint.state)
    return number


def test_the_same_observations_lead_to_the_same_decisions(run: RunFolder, knowledge: KnowledgeBase) -> None:
    kinds = {decision.kind for decision in knowledge.decisions(1)}
    assert {"update", "settled"} <= kinds
    assert check_decisions(run, knowledge, 1) == ()


def test_the_log_is_in_the_file_and_in_the_knowledge_base(run: RunFolder, knowledge: KnowledgeBase) -> None:
    lines = (run.path / FILE_NAME).read_text().splitlines()
    assert len(lines) >= 7
    assert [json.loads(line) for line in lines] == [event_record(event) for event in knowledge.events(1)]


def test_replay_checks_on_request(
    run: RunFolder,
    knowledge: KnowledgeBase,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    replay = CommandLine(monkeypatch, capsys, "knowledge", "replay", "--db", default_url(run.path))
    number = forged(knowledge, DecisionRow(2, 1, "replan", ("no reason",)))
    same, other = (replay(wanted, "--check", run.path) for wanted in (1, number))
    assert (same.code, same.err) == (0, "")
    assert same.out.splitlines()[-1] == "the same is done and decided again"
    assert (other.code, other.err) == (1, "")
    assert other.out.splitlines()[-1] == "episode 2, step 1: replan: recorded 'no reason', derived nothing"


def test_a_decision_that_does_not_follow_is_found(run: RunFolder, knowledge: KnowledgeBase) -> None:
    number = forged(knowledge, DecisionRow(2, 1, "replan", ("no reason",)))
    (found,) = check_decisions(run, knowledge, number)
    assert str(found) == "episode 2, step 1: replan: recorded 'no reason', derived nothing"


def test_actions_that_do_not_follow_are_found(run: RunFolder, knowledge: KnowledgeBase) -> None:
    found = check_decisions(run, knowledge, forged(knowledge, manager="random"))
    assert {difference.kind for difference in found} >= {"action", "update"}


def test_what_is_no_run_of_a_loop_with_this_case_is_refused(run: RunFolder, knowledge: KnowledgeBase) -> None:
    other = knowledge.start_run("other", "other", "digest", {})
    with pytest.raises(InputError, match=f"run {other} was made with another case"):
        check_decisions(run, knowledge, other)
    bare = knowledge.start_run("bare", run.case.name, run.case.digest, {})
    with pytest.raises(InputError, match=f"run {bare} is not one of a loop: it has no scenario"):
        check_decisions(run, knowledge, bare)
    wrong = knowledge.start_run("w", "c", run.case.digest, {"scenario": {"episodes": 0}, "manager": "merap"})
    with pytest.raises(InputError, match=f"run {wrong}"):
        check_decisions(run, knowledge, wrong)
