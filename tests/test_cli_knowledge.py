"""`merap knowledge` as a user calls it: each call is a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from merap.online.knowledge.base import open_knowledge
from tests.recorded_runs import SETTINGS, record_run


def merap(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "merap", "knowledge", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def printed(*arguments: object) -> str:
    done = merap(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def refused(*arguments: object) -> str:
    """The one clear line of a refusal."""
    done = merap(*arguments)
    assert done.returncode == 2, done
    assert done.stdout == ""
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("error: ")
    return line


@pytest.fixture(scope="module")
def db(tmp_path_factory: pytest.TempPathFactory) -> str:
    url = f"sqlite:///{tmp_path_factory.mktemp('runs') / 'knowledge.db'}"
    with open_knowledge(url) as knowledge:
        record_run(knowledge)
        knowledge.start_run("killed", "other_case", "e" * 64, {})
    return url


def test_list_has_a_row_for_each_run(db: str) -> None:
    _, first, second = printed("list", "--db", db).splitlines()
    assert first.split()[:3] == ["1", "shifts.merap", "running_example"]
    assert first.split()[-2:] == ["5", "2"]
    assert second.split()[:3] == ["2", "killed", "other_case"]
    assert second.split()[-3:] == ["-", "0", "0"]


def test_list_and_show_of_postgresql_as_json(postgresql_url: str) -> None:
    with open_knowledge(postgresql_url) as knowledge:
        run = record_run(knowledge)
    (listed,) = json.loads(printed("list", "--db", postgresql_url, "--json", "-"))
    assert (listed["id"], listed["name"], listed["settings"]) == (run, "shifts.merap", SETTINGS)
    assert listed["entries"]["observation"] == 5
    shown = json.loads(printed("show", run, "--db", postgresql_url, "--json", "-"))
    assert {**shown, **listed} == shown
    assert [decision["kind"] for decision in shown["decisions"]] == ["replan", "settled"]
    assert [policy["kind"] for policy in shown["policies"]] == ["meta", "adapted"]
    assert [(event["component"], event["message"]) for event in shown["events"]] == [("monitor", "late")]


def test_show_prints_settings_reasons_and_events(db: str) -> None:
    text = printed("show", 1, "--db", db)
    for part in (
        "run 1: shifts.merap, case running_example (dddddddddddd)",
        "strategy: belief",
        "5 observation, 2 decision",
        "policies: 1 meta, 1 adapted",
        "reward fell below 0.5; a goal was moved",
        "2026-11-24T18:00:00.123",
    ):
        assert part in text
    assert "finished -" in printed("show", 2, "--db", db, "--last", 0)


def test_replay_is_a_timeline(db: str, tmp_path: Path) -> None:
    report = tmp_path / "timeline.json"
    _, *lines = map(str.rstrip, printed("replay", 1, "--db", db, "--json", report).splitlines())
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


def test_export_says_what_it_wrote(db: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert printed("export", 1, "--db", db, "-o", out) == f"wrote 9 files and a manifest to {out}\n"
    assert len([*out.iterdir()]) == 10


def test_what_there_is_not_is_named(db: str, tmp_path: Path) -> None:
    missing = tmp_path / "missing.db"
    assert f"{missing}: there is no knowledge base" in refused("list", "--db", f"sqlite:///{missing}")
    assert not missing.exists()
    assert "there is no run 7" in refused("replay", 7, "--db", db)
