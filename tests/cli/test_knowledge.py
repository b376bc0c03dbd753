"""`merap knowledge` as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from merap.knowledge.base import open_knowledge
from merap.knowledge.rows import ObservationRow
from merap.learning.config import TrainingConfig
from tests.support.command_line import CommandLine
from tests.support.paths import MODELS
from tests.support.recorded_runs import SETTINGS, record_run
from tests.support.trained_runs import trained


@pytest.fixture
def knowledge(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(monkeypatch, capsys, "knowledge")


@pytest.fixture(scope="module")
def db(tmp_path_factory: pytest.TempPathFactory) -> str:
    url = f"sqlite:///{tmp_path_factory.mktemp('runs') / 'knowledge.db'}"
    with open_knowledge(url) as opened:
        record_run(opened)
        opened.start_run("killed", "other_case", "e" * 64, {})
    return url


def test_list_has_a_row_for_each_run(knowledge: CommandLine, db: str) -> None:
    _, first, second = knowledge.printed("list", "--db", db).splitlines()
    assert first.split()[:3] == ["1", "shifts.merap", "running_example"]
    assert first.split()[-2:] == ["5", "2"]
    assert second.split()[:3] == ["2", "killed", "other_case"]
    assert second.split()[-3:] == ["-", "0", "0"]


def test_an_empty_list_says_where_without_a_password(knowledge: CommandLine, postgresql_url: str) -> None:
    open_knowledge(postgresql_url).close()
    line = knowledge.printed("list", "--db", postgresql_url)
    assert line.startswith("postgresql://postgres:***@127.0.0.1:")
    assert line.endswith("/postgres: no runs\n")


def test_list_and_show_of_postgresql_as_json(knowledge: CommandLine, postgresql_url: str) -> None:
    with open_knowledge(postgresql_url) as opened:
        run = record_run(opened)
    (listed,) = json.loads(knowledge.printed("list", "--db", postgresql_url, "--json", "-"))
    assert (listed["id"], listed["name"], listed["settings"]) == (run, "shifts.merap", SETTINGS)
    assert listed["entries"]["observation"] == 5
    shown = json.loads(knowledge.printed("show", run, "--db", postgresql_url, "--json", "-"))
    assert {**shown, **listed} == shown
    assert [decision["kind"] for decision in shown["decisions"]] == ["replan", "settled"]
    assert [policy["kind"] for policy in shown["policies"]] == ["meta", "adapted"]
    assert [(event["component"], event["message"]) for event in shown["events"]] == [("monitor", "late")]


def test_show_prints_settings_reasons_and_events(knowledge: CommandLine, db: str) -> None:
    text = knowledge.printed("show", 1, "--db", db)
    for part in (
        "run 1: shifts.merap, case running_example (dddddddddddd)",
        "strategy: belief",
        "5 observation, 2 decision",
        "policies: 1 meta, 1 adapted",
        "reward fell below 0.5; a goal was moved",
        "2026-11-24T18:00:00.123",
    ):
        assert part in text
    assert "finished -" in knowledge.printed("show", 2, "--db", db, "--last", 0)


def test_replay_is_a_timeline(knowledge: CommandLine, db: str, tmp_path: Path) -> None:
    report = tmp_path / "timeline.json"
    _, *lines = map(str.rstrip, knowledge.printed("replay", 1, "--db", db, "--json", report).splitlines())
    assert [line.split()[:3] for line in lines] == [
        ["0", "0", "reset"],
        ["0", "1", "action"],
        ["0", "1", "decision:"],
        ["0", "2", "action"],
        ["1", "1", "action"],
        ["1", "1", "decision:"],
        ["1", "2", "action"],
    ]
    assert lines[3].endswith("nothing seen")
    assert lines[4].endswith("0 8 (done)")
    assert lines[6].endswith("0 7 (truncated)")
    timeline = json.loads(report.read_text())["timeline"]
    assert [next(iter(record)) for record in timeline] == [
        "observation",
        "observation",
        "decision",
        "observation",
        "observation",
        "decision",
        "observation",
    ]


def test_export_says_what_it_wrote(knowledge: CommandLine, db: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert knowledge.printed("export", 1, "--db", db, "-o", out) == f"wrote 9 files and a manifest to {out}\n"
    assert len([*out.iterdir()]) == 10


def test_what_there_is_not_is_named(knowledge: CommandLine, db: str, tmp_path: Path) -> None:
    missing = tmp_path / "missing.db"
    assert f"{missing}: there is no knowledge base" in knowledge.refused(
        "list", "--db", f"sqlite:///{missing}"
    )
    assert not missing.exists()
    assert "there is no run 7" in knowledge.refused("replay", 7, "--db", db)


def test_export_over_an_earlier_one_needs_force(knowledge: CommandLine, db: str, tmp_path: Path) -> None:
    knowledge.printed("export", 1, "--db", db, "-o", tmp_path)
    assert "manifest.json: exists already" in knowledge.refused("export", 2, "--db", db, "-o", tmp_path)
    knowledge.printed("export", 2, "--db", db, "-o", tmp_path, "--force")
    assert json.loads((tmp_path / "run.json").read_text())["name"] == "killed"


def test_a_knowledge_base_is_named_by_its_file_or_folder_too(knowledge: CommandLine, db: str) -> None:
    file = Path(db.removeprefix("sqlite:///"))
    expected = knowledge.printed("list", "--db", db)
    assert knowledge.printed("list", "--db", file) == expected
    assert knowledge.printed("list", "--db", file.parent) == expected


def test_replay_and_show_speak_in_names_where_the_run_folder_tells(
    knowledge: CommandLine, tmp_path: Path
) -> None:
    run = trained(tmp_path / "run")
    with open_knowledge(f"sqlite:///{run.path / 'knowledge.db'}") as opened:
        number = opened.start_run("grid", run.case.name, run.case.digest, {"scenario": {"episodes": 3}})
        opened.record_observations(number, [ObservationRow(0, 1, (3, 4, 0), 1, -0.5, 1.0, False)])
    (_, row) = knowledge.printed("replay", 1, "--db", run.path).splitlines()
    assert row.split() == ["0", "1", run.case.actions[1], "-0.5", "row=3", "col=4"]
    assert "  scenario:\n    episodes: 3\n" in knowledge.printed("show", 1, "--db", run.path)


def test_replay_shows_where_a_task_was_completed(knowledge: CommandLine, tmp_path: Path) -> None:
    config = TrainingConfig(updates=1, hidden=(4,), episodes=2)
    run = trained(tmp_path / "run", config, MODELS / "running-example")
    with open_knowledge(f"sqlite:///{tmp_path / 'k.db'}") as opened:
        number = opened.start_run("grid", run.case.name, run.case.digest, {})
        opened.record_observations(number, [ObservationRow(0, 1, (0, 2), 1, 9.5, 0.0, False)])
    (_, row) = knowledge.printed("replay", 1, "--db", tmp_path / "k.db").splitlines()
    assert row.split()[-3:] == ["0", "2", "(done)"]
    (tmp_path / "k.db").rename(run.path / "knowledge.db")
    (_, row) = knowledge.printed("replay", 1, "--db", run.path).splitlines()
    assert row.split() == ["0", "1", run.case.actions[1], "9.5", "loc=S", "mode=scanned", "(done)"]
