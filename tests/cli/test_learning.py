"""`train` and `adapt` as a user calls them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from merap.learning.config import TrainingConfig
from merap.runs.run_folder import RunFolder, read_run
from tests.support.command_line import command, merap, refused
from tests.support.paths import MODELS
from tests.support.trained_runs import (
    ONE_OF_THREE,
    SMALL,
    checkpoint_update,
    contents,
    trained,
    what_was_learned,
)

# Long enough to be killed in the middle ten times.
SHORT = TrainingConfig(updates=200, hidden=(4,), episodes=5)
# of training, whatever the machine: ten processes that each get to a checkpoint take some 6 seconds
SECONDS = 12
KILLS = 10


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "finished")


def test_train_takes_settings_from_options_words_and_a_file(finished: RunFolder, tmp_path: Path) -> None:
    """Options win over words, words over the file; and the result is that of the same from Python."""
    file = tmp_path / "settings.yaml"
    file.write_text("{hidden: [4], updates: 1, episodes: 1, seed: 7}")
    out = tmp_path / "run"
    done = merap(
        "train", ONE_OF_THREE, "-o", out, "--config", file,
        "--set", "episodes=5", "--set", "seed=8", "--updates", "5", "--seed", "0",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("3 tasks, 5 updates in ")
    assert read_run(out).config == SMALL
    assert what_was_learned(out) == what_was_learned(finished.path)


def test_train_refuses_a_wrong_setting_and_writes_nothing(tmp_path: Path) -> None:
    out = tmp_path / "run"
    line = refused("train", ONE_OF_THREE, "-o", out, "--set", "udpates=3")
    assert line == "error: --set udpates=3: udpates: unknown setting; did you mean 'updates'?"
    assert not out.exists()


def test_train_refuses_a_folder_that_holds_something(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    assert str(tmp_path) in refused("train", ONE_OF_THREE, "-o", tmp_path, "--updates", "1")
    assert contents(tmp_path) == {"thesis.tex": b"years of work"}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--resume", "--seed", "1"], "--resume goes on with the run's own case and settings"),
        (["--resume"], "is not a run folder"),
    ],
)
def test_train_refuses_what_makes_no_sense(tmp_path: Path, arguments: list[str], complaint: str) -> None:
    assert complaint in refused("train", "-o", tmp_path, *arguments)
    assert contents(tmp_path) == {}


@pytest.mark.process
@pytest.mark.slow
def test_a_run_killed_ten_times_in_the_middle_goes_on_bit_for_bit(tmp_path: Path) -> None:
    """Parameters, optimizer, generator and metrics are those of an undisturbed run."""
    begun = time.monotonic()
    trained(tmp_path / "short", SHORT)
    updates = int(SHORT.updates * SECONDS / (time.monotonic() - begun))
    undisturbed = trained(tmp_path / "undisturbed", SHORT.model_copy(update={"updates": updates}))
    settings = ["--updates", str(updates), "--set", "hidden=[4]", "--set", "episodes=5"]
    out = tmp_path / "killed"
    reached = [0]
    for number in range(KILLS):
        words = ["--resume", "-o", str(out)] if number else [str(ONE_OF_THREE), "-o", str(out), *settings]
        process = subprocess.Popen(
            command("train", *words), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            wait_for(lambda: checkpoint_update(out) > reached[-1], process)
            time.sleep(np.random.default_rng().uniform(0, 0.1))  # at any moment between two checkpoints
        finally:
            os.kill(process.pid, signal.SIGKILL)
        assert process.wait(60) == -signal.SIGKILL
        assert not (out / "policy.safetensors").exists()
        reached.append(checkpoint_update(out))
    # each process got further, and none to the end
    assert reached == sorted(set(reached))
    assert reached[-1] < updates
    done = merap("train", "--resume", "-o", out)
    assert done.returncode == 0, done.stderr
    assert f" {updates - reached[-1]} updates in" in done.stdout
    assert what_was_learned(out) == what_was_learned(undisturbed.path)


def wait_for(happened: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 120
    while not happened():
        assert process.poll() is None, "training ended before it could be killed"
        assert time.monotonic() < deadline, "no progress in two minutes"
        time.sleep(0.01)


def test_adapt_writes_its_curves_as_json_and_pictures(finished: RunFolder, tmp_path: Path) -> None:
    report, out = tmp_path / "adaptation.json", tmp_path / "pictures"
    done = merap(
        "adapt", finished.path, "--system", "met", "--strategy", "gradient", "--episodes-per-step", "5",
        "--steps", "3", "--seeds", "2:4", "--json", report, "-o", out,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "expected return" in done.stdout
    assert set(contents(out)) == {"report.json", "curve.png", "curve.svg", "map.png", "map.svg"}
    assert (out / "report.json").read_text() == report.read_text()
    found = json.loads(report.read_text())
    assert list(found) == [
        *("system", "reward_noise", "slip", "reset"),
        *("strategy", "optimum", "worst", "safe_optimum", "safely_completed"),
        *("runs", "reasons", "summary", "safety"),
    ]
    assert (found["system"], found["strategy"]) == ("met", "gradient")
    # RQ1-3: the goal is eight steps away, whatever cell can't be entered
    assert (found["optimum"], found["worst"]) == (pytest.approx(6), pytest.approx(-9))
    assert [run["seed"] for run in found["runs"]] == [2, 3]
    for run in found["runs"]:
        assert list(run) == [
            "seed",
            "curve",
            "steps_to_within_5_percent",
            "episodes_to_within_5_percent",
            "episodes_to_solved",
            "first_episode_regret",
            "cumulative_regret",
            "sampled_regret",
            "steps_back",
            "too_short",
        ]
        rows = run["curve"]
        assert all(list(row) == ["step", "episodes", "expected_return", "sampled_return"] for row in rows)
        assert [(row["step"], row["episodes"]) for row in rows] == [(0, 0), (1, 5), (2, 10), (3, 15)]
        assert rows[0]["sampled_return"] is None
    assert found["summary"]["runs"] == 2
    assert found["summary"]["mean_initial_return"] == found["runs"][0]["curve"][0]["expected_return"]


def test_adapt_by_belief_prints_json_alone(finished: RunFolder) -> None:
    done = merap(
        "adapt", finished.path, "--strategy", "belief", "--max-episodes", "2", "--seeds", "1", "--json", "-",
        "--slip", "0.1", "--reward-noise", "0.5", "--reset", "return_to_start",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["strategy"] == "belief"
    assert (found["reward_noise"], found["slip"], found["reset"]) == (0.5, 0.1, "return_to_start")
    assert [[row["episodes"] for row in run["curve"]] for run in found["runs"]] == [[0, 1, 2]]
    assert [run["seed"] for run in found["runs"]] == [1]


def test_adapt_shows_the_spread_of_pretrained_policies(finished: RunFolder, tmp_path: Path) -> None:
    report = tmp_path / "spread.json"
    done = merap("adapt", finished.path, "--strategy", "pretrained:all", "--steps", "1", "--json", report)
    assert done.returncode == 0, done.stderr
    found = json.loads(report.read_text())
    assert found["strategy"] == "pretrained:all"
    assert set(found["values"]) == set(finished.names)
    for part in ("best_policy", "median_policy", "worst_policy"):
        assert found[part]["strategy"].removeprefix("pretrained:") in finished.names
        assert found[part]["strategy"] in done.stdout
    stored = finished.path / "baselines" / "pretrained"
    assert set(contents(stored)) == {f"{name}.safetensors" for name in finished.names}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            ["--strategy", "ope", "--max-episodes", "20"],
            "--max-episodes: a step of ope takes 35 real episodes, so 20 are too few for one; give at least "
            "35, or fewer by --episodes-per-step",
        ),
        (["--steps", "2", "--max-episodes", "8"], "--max-episodes: --steps says how long already"),
        (["--seeds", "²"], "expected a:b with whole numbers or one seed, got '²'"),
        (["--system", "mett"], "'mett'"),
        (["--slip", "1"], "the probability to slip must be in [0, 1), it is 1.0"),
        (["--strategy", "pretrained"], "'pretrained' lacks a combination"),
        (["--strategy", "pretrained:open.full.goal_r4c5"], "no combination 'open.full.goal_r4c5'"),
    ],
)
def test_adapt_refuses_what_there_is_not(
    finished: RunFolder, tmp_path: Path, arguments: list[str], complaint: str
) -> None:
    report = tmp_path / "adaptation.json"
    assert complaint in refused("adapt", finished.path, *arguments, "--json", report)
    assert not report.exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["adapt", "RUN"],
        ["export-policy", "RUN", "-o", "RUN/policy.csv"],
        ["run", "RUN", "--scenario", MODELS / "running-example" / "three-changes.yaml"],
        ["train", "-o", "RUN", "--resume"],
        ["train", ONE_OF_THREE, "--from", "RUN", "-o", "RUN/next"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_run_whose_case_was_edited_is_one_line(
    finished: RunFolder, tmp_path: Path, arguments: list[object]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished.path, run)
    case = run / "case.yaml"
    case.write_text(case.read_text().replace("value: 10", "value: 11"))
    before = contents(run)
    line = refused(*(str(word).replace("RUN", str(run)) for word in arguments))
    assert line.startswith(
        f"error: {case}: has changed since this folder was made: its SHA-256 is not that of"
    )
    assert contents(run) == before


def test_adapt_says_where_it_is_too_short_to_tell_and_prints_the_last_row(finished: RunFolder) -> None:
    """The oracle is at the optimum from row 0 on; three rows in a row are needed."""
    arguments = ["adapt", finished.path, "--strategy", "oracle", "--steps"]
    short = merap(*arguments, "1").stdout
    assert "never: 0 of 1 runs" in short
    assert "too short to tell: 1 of 1 runs" in short
    long = merap(*arguments, "8").stdout
    assert "too short" not in long
    assert [line.split()[0] for line in long.splitlines()[2:8]] == ["0", "1", "2", "3", "5", "8"]


def test_adapt_warns_of_an_option_that_means_nothing(finished: RunFolder) -> None:
    done = merap("adapt", finished.path, "--strategy", "oracle", "--episodes-per-step", "7", "--steps", "1")
    assert done.returncode == 0
    assert done.stderr == (
        "warning: --episodes-per-step is of gradient and ope alone: oracle takes 1 episode each\n"
    )


@pytest.mark.parametrize("option", ["-o", "--json"])
def test_adapt_finds_out_first_whether_it_can_write(finished: RunFolder, tmp_path: Path, option: str) -> None:
    (tmp_path / "curve.svg").write_text("mine")
    place = tmp_path if option == "-o" else tmp_path / "no" / "such.json"
    complaint = "curve.svg: exists already" if option == "-o" else f"there is no folder {tmp_path / 'no'}"
    # without a run folder the work itself would fail otherwise
    assert complaint in refused("adapt", tmp_path / "no run", option, place)
    assert "can't be written" in refused("adapt", tmp_path / "no run", option, "/proc/nope")
    assert contents(tmp_path) == {"curve.svg": b"mine"}


def test_adapt_does_not_write_over_a_report(finished: RunFolder, tmp_path: Path) -> None:
    report = tmp_path / "adaptation.json"
    report.write_text("mine")
    assert str(report) in refused("adapt", finished.path, "--steps", "1", "--json", report)
    assert report.read_text() == "mine"
