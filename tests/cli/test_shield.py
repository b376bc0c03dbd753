"""`adapt --shield` as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from merap.runs.run_folder import RunFolder
from tests.support.command_line import merap
from tests.support.paths import MODELS
from tests.support.trained_runs import trained

HAZARDS = MODELS / "hazard-grid" / "case.yaml"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run", case=HAZARDS)


@pytest.mark.slow
def test_a_shielded_strategy_violates_nothing_and_the_report_says_so(run: RunFolder, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    options = ("--strategy", "gradient", "--episodes-per-step", "3", "--steps", "1", "--seeds", "0:2")
    done = merap("adapt", run.path, *options, "--shield", "0", "--json", report)
    assert done.returncode == 0, done.stderr
    safety = json.loads(report.read_text())["safety"]
    assert (safety["total"]["episodes"], safety["total"]["violations"]) == (6, 0)
    assert safety["total"]["shield"]["fallbacks"] == 0
    assert [one["episodes"] for one in safety["runs"]] == [3, 3]
    assert "violations: 0 of 6 episodes" in done.stdout
    assert "shield at 0: " in done.stdout
    alone = merap("adapt", run.path, *options, "--json", "-")
    unshielded = json.loads(alone.stdout)["safety"]["total"]
    assert unshielded["episodes"] == 6
    assert unshielded["shield"] is None


def test_a_prior_without_a_shield_is_refused(run: RunFolder) -> None:
    done = merap("adapt", run.path, "--hazard-prior", "0.1")
    assert done.returncode == 2
    assert "--hazard-prior: a prior on hazards needs a shield: give --shield too" in done.stderr
    assert done.stdout == ""


@pytest.mark.slow
def test_a_task_that_is_hopeless_within_the_threshold_is_called_so(run: RunFolder) -> None:
    """At `island` every way to the goal risks 0.1: at 0 a robot stays away, -1 in each of 40 steps."""
    arguments = ["adapt", run.path, "--system", "island", "--strategy", "oracle", "--steps", "1", "--shield"]
    hopeless = merap(*arguments, "0")
    assert "within the shield's threshold at most -40 can be earned, and the task can't be" in hopeless.stdout
    found = json.loads(merap(*arguments, "0.3", "--json", "-").stdout)
    assert found["safely_completed"] > 0.5
    assert -40 < found["safe_optimum"] <= found["optimum"]
