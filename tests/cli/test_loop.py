"""`merap run` as a user calls it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from merap.knowledge.base import open_knowledge
from merap.runs.run_folder import RunFolder
from tests.support.command_line import command, merap, refused
from tests.support.loop_runs import MOVED
from tests.support.trained_runs import contents, trained

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "moved.yaml"
    path.write_text(MOVED, encoding="utf-8")
    return path


@pytest.mark.slow
def test_run_is_killed_and_goes_on_and_writes_report_and_timeline(
    run: RunFolder, scenario: Path, tmp_path: Path
) -> None:
    database, out = tmp_path / "k.db", tmp_path / "out"
    log, url = tmp_path / "events.jsonl", f"sqlite:///{database}"
    arguments = ["run", str(run.path), "--scenario", str(scenario), "--db", url, "--log", str(log)]
    process = subprocess.Popen(command(*arguments), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not log.exists() or not log.stat().st_size:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait(60) == -signal.SIGKILL
    report = tmp_path / "report.json"
    done = merap(*arguments, "--resume", "-o", out, "--json", report)
    assert done.returncode == 0, done.stderr
    assert set(contents(out)) == {"report.json", "timeline.png", "timeline.svg"}
    found = json.loads(report.read_text())
    assert [row["episode"] for row in found["episodes"]] == list(range(10))
    assert [reaction["changed"] for reaction in found["reactions"]] == [["objective"]]
    assert "10 episodes returned" in done.stdout
    told = done.stderr.splitlines()  # no terminal: a line for each tenth of the episodes
    assert len(told) == 10
    assert told[-1].startswith("10 of 10 episodes; the last returned ")
    assert "recovered from" in done.stdout
    with open_knowledge(url) as knowledge:
        assert [row.name for row in knowledge.runs()] == ["moved.merap"]


def test_the_log_is_a_file_of_json_lines(run: RunFolder, scenario: Path, tmp_path: Path) -> None:
    log = tmp_path / "events.jsonl"
    done = merap(
        "run", run.path, "--scenario", scenario, "--db", f"sqlite:///{tmp_path / 'k.db'}", "--log", log,
        "--manager", "none", "--json", "-",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["manager"] == "none"
    assert done.stderr == ""
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert len(events) == 10
    assert all(event["message"].startswith(f"episode {index} ") for index, event in enumerate(events))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--manager", "reactiv"], "there is no manager 'reactiv'; did you mean 'reactive'?"),
        (["--resume"], "there is no run 'moved.merap' in the knowledge base to go on with"),
    ],
)
def test_run_refuses_what_there_is_not(
    run: RunFolder, scenario: Path, tmp_path: Path, arguments: list[str], complaint: str
) -> None:
    report = tmp_path / "report.json"
    database = f"sqlite:///{tmp_path / 'k.db'}"
    line = refused("run", run.path, "--scenario", scenario, "--db", database, *arguments, "--json", report)
    assert complaint in line
    assert not report.exists()


def test_a_wrong_scenario_is_one_line_with_its_place(run: RunFolder, scenario: Path) -> None:
    scenario.write_text(MOVED.replace("episodes: 10", "episodes: ten"))
    line = refused("run", run.path, "--scenario", scenario)
    assert line == f"error: {scenario}:3: episodes: expected a whole number, got 'ten'"


def test_run_finds_out_first_whether_it_can_write(scenario: Path, tmp_path: Path) -> None:
    arguments = ["run", tmp_path / "no run", "--scenario", scenario]
    assert "/proc/nope: can't be written" in refused(*arguments, "-o", "/proc/nope")
    assert "there is no folder" in refused(*arguments, "--json", tmp_path / "no" / "such.json")
    assert "there is no folder" in refused(*arguments, "--log", tmp_path / "no" / "such.jsonl")
    assert "is a folder, expected the name of a file" in refused(*arguments, "--log", tmp_path)
    assert set(contents(tmp_path)) == {"moved.yaml"}


def test_run_does_not_write_over_a_report(run: RunFolder, scenario: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "timeline.svg").write_text("mine")
    assert "timeline.svg: exists already" in refused("run", run.path, "--scenario", scenario, "-o", out)
    assert contents(out) == {"timeline.svg": b"mine"}
