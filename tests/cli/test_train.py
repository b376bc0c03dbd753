"""`train` as a user calls it: the end it comes to, longer runs, goals that are cut off, progress."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from merap.cli import output
from merap.runs.run_folder import RunFolder, read_run
from merap.runs.train import resume
from tests.support.command_line import merap, refused
from tests.support.paths import MODELS
from tests.support.trained_runs import ONE_OF_THREE, checkpoint_update, contents, trained, what_was_learned

SMALL_WORDS = ("--updates", "5", "--set", "hidden=[4]", "--set", "episodes=5")


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    return trained(tmp_path / "run")


def with_horizon(folder: Path, horizon: int) -> Path:
    """RQ1-3, whose goal is eight steps away."""
    text = ONE_OF_THREE.read_text().replace("horizon: 18", f"horizon: {horizon}")
    (folder / "case.yaml").write_text(text)
    return folder / "case.yaml"


def test_train_ends_with_adapted_return_and_optimum(tmp_path: Path) -> None:
    done = merap("train", ONE_OF_THREE, "-o", tmp_path / "run", *SMALL_WORDS)
    assert done.returncode == 0, done.stderr
    assert re.search(
        r"\nafter 1 gradient step of 5 episodes the adapted policies return -\d\.\d+ on average over "
        r"3 tasks; the best possible is 6\n$",
        done.stdout,
    )
    assert "warning: little was learned: over acting at random the adapted policies gain " in done.stderr
    assert f"merap adapt {tmp_path / 'run'} --strategy belief" in done.stderr


@pytest.mark.slow
def test_train_warns_of_policies_that_never_complete_the_task(tmp_path: Path) -> None:
    done = merap("train", MODELS / "hazard-grid", "-o", tmp_path / "run")
    assert (
        "warning: no adapted policy ever completes its task: each goes on until the horizon\n" in done.stderr
    )


@pytest.mark.slow
def test_train_does_not_warn_where_enough_was_learned(tmp_path: Path) -> None:
    done = merap("train", ONE_OF_THREE, "-o", tmp_path / "run")
    assert done.returncode == 0
    assert "warning" not in done.stderr


def test_a_finished_run_can_be_lengthened(run: RunFolder) -> None:
    done = merap("train", "-o", run.path, "--resume", "--updates", "8")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("3 tasks, 3 updates in ")
    assert read_run(run.path).config.updates == 8
    assert checkpoint_update(run.path) == 8
    assert json.loads((run.path / "outcome.json").read_text())["updates"] == 8
    assert (run.path / "policy.safetensors").exists()
    assert len((run.path / "metrics.csv").read_text().splitlines()) == 9
    # a run that begins with as many updates has other schedules, but the same number of rows
    again = merap("train", "-o", run.path, "--resume", "--updates", "8")
    assert again.returncode == 0
    assert again.stdout.startswith("3 tasks, 0 updates in ")


def test_lengthening_is_the_same_from_python(run: RunFolder, tmp_path: Path) -> None:
    other = trained(tmp_path / "other")
    assert merap("train", "-o", run.path, "--resume", "--updates", "8").returncode == 0
    resume(str(other.path), updates=8)
    assert what_was_learned(run.path) == what_was_learned(other.path)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--updates", "4"], "updates: the run has 5; expected more, got 4"),
        (["--updates", "0"], "options: updates: expected a number of at least 1, got 0"),
        (["--updates", "8", "--seed", "1"], "of which only --updates may grow"),
        (["--set", "updates=8"], "of which only --updates may grow"),
    ],
)
def test_other_changes_of_a_run_are_refused(run: RunFolder, words: list[str], complaint: str) -> None:
    before = contents(run.path)
    assert complaint in refused("train", "-o", run.path, "--resume", *words)
    assert contents(run.path) == before


def test_a_run_that_is_being_lengthened_counts_as_unfinished(run: RunFolder) -> None:
    """Killed in between, it goes on; nothing takes its old policy for the new one."""
    resume(run.path, lambda row: None, updates=6)
    (run.path / "policy.safetensors").unlink()
    line = refused("adapt", run.path)
    assert line.endswith(f"training has not ended; go on with: merap train -o {run.path} --resume")
    assert merap("train", "-o", run.path, "--resume").returncode == 0


def test_a_folder_that_is_taken_is_refused_with_a_command_that_runs(run: RunFolder) -> None:
    line = refused("train", ONE_OF_THREE, "-o", run.path)
    assert line.endswith(f"choose another folder, or go on with: merap train -o {run.path} --resume")
    assert merap(*line.split("go on with: merap ")[1].split()).returncode == 0


def test_a_folder_of_something_else_can_not_be_gone_on_with(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    assert "--resume" not in refused("train", ONE_OF_THREE, "-o", tmp_path)


def test_a_base_without_a_way_to_its_goal_is_named(tmp_path: Path) -> None:
    case, run = with_horizon(tmp_path, 7), tmp_path / "run"
    warned = (
        "warning: no task can reach its goal within 7 steps; cut off: open.no_entry_r3c4.middle, "
        "open.no_entry_r4c3.middle, open.no_entry_r3c3.middle\n"
    )
    assert warned in merap("train", case, "-o", run, *SMALL_WORDS).stderr
    adapted = merap("adapt", run, "--max-episodes", "1")
    assert warned in adapted.stderr
    assert "warning: met can't reach its goal within 7 steps\n" in adapted.stderr


def test_members_without_a_way_to_their_goal_are_named(tmp_path: Path) -> None:
    text = (MODELS / "running-example" / "case.yaml").read_text()
    (tmp_path / "case.yaml").write_text(
        text.replace("b_blocked: {blocked: [B]}", "b_blocked: {blocked: [A, B, C]}")
    )
    done = merap("train", tmp_path / "case.yaml", "-o", tmp_path / "run", *SMALL_WORDS)
    assert (
        "warning: not every task (12 of 18) can reach its goal within 40 steps; cut off: "
        "b_blocked.speed_low.g1, b_blocked.speed_low.g2, b_blocked.speed_low.g3, b_blocked.speed_high.g1, "
        "b_blocked.speed_high.g2 and 1 more\n"
    ) in done.stderr


def test_a_goal_that_is_just_in_reach_is_none_to_warn_of(tmp_path: Path) -> None:
    done = merap("train", with_horizon(tmp_path, 8), "-o", tmp_path / "run", *SMALL_WORDS)
    assert "cut off" not in done.stderr


def test_progress_is_told_in_plain_lines_where_nobody_watches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "FIRST_LINE_AFTER", 0.0)
    done = merap("train", ONE_OF_THREE, "-o", tmp_path / "run", *SMALL_WORDS)
    assert "Building models: 1 of 3\n" in done.stderr
    assert re.search(r"Training: 1 of 5, \d+/s, adapted return -\d", done.stderr)
    assert re.search(r"Training: 5 of 5, ", done.stderr)
    assert "\x1b" not in done.stderr


def test_a_short_job_tells_no_progress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "FIRST_LINE_AFTER", 60.0)
    done = merap("render", ONE_OF_THREE, "-o", tmp_path / "models")
    assert (done.returncode, done.stderr) == (0, "")
