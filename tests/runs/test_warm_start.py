"""Training from where another run has ended."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from merap.errors import InputError
from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.learning.progress import UpdateMetrics
from merap.runs.checkpoint import read_checkpoint, read_policy
from merap.runs.run_folder import RunFolder, read_run
from merap.runs.train import begin_run, resume, tasks_of, train, train_run
from tests.support.command_line import merap
from tests.support.paths import MODELS
from tests.support.trained_runs import ONE_OF_THREE, SMALL, contents, grid_case, trained

OTHER_WORLD = MODELS / "running-example"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "finished")


def test_it_begins_with_what_was_learned(finished: RunFolder, tmp_path: Path) -> None:
    run = begin_run(tmp_path / "new", grid_case(), finished.config, finished)
    tasks = tasks_of(run)
    state, metrics = read_checkpoint(run, tasks)
    learned = read_policy(finished, tasks)
    assert not metrics
    assert state.update == 0
    flat = torch.cat([value.flatten() for value in learned.parameters.values()])
    assert torch.equal(state.theta, flat)
    sizes = torch.cat([value.flatten() for value in learned.step_sizes.values()])
    torch.testing.assert_close(state.log_step_sizes.exp(), sizes)
    manifest = json.loads((run.path / "manifest.json").read_text())
    assert manifest["begun_from"] == {"case": finished.case.name, "digest": finished.case.digest}


def test_a_few_more_updates_are_worth_more_than_from_nothing(finished: RunFolder, tmp_path: Path) -> None:
    """The first adapted return is what the source ends with, not what random parameters give."""
    few = finished.config.model_copy(update={"updates": 2})
    returns: dict[str, list[float]] = {"cold": [], "warm": []}

    def note(name: str, metrics: UpdateMetrics) -> None:
        returns[name].append(metrics.adapted_return)

    train(grid_case(), tmp_path / "cold", few, lambda row: note("cold", row))
    train(grid_case(), tmp_path / "warm", few, lambda row: note("warm", row), finished)
    assert min(returns["warm"]) > max(returns["cold"])


def test_it_goes_on_after_an_interruption_bit_for_bit(finished: RunFolder, tmp_path: Path) -> None:
    whole = train(grid_case(), tmp_path / "whole", source=finished)
    halved = begin_run(tmp_path / "halved", grid_case(), finished.config, finished)

    def interrupt(metrics: UpdateMetrics) -> None:
        if metrics.update == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_run(halved, interrupt)
    resume(halved.path)
    for name in ("policy.safetensors", "metrics.csv"):
        assert contents(whole.path)[name] == contents(halved.path)[name]


@pytest.mark.parametrize(
    ("case", "changed", "complaint"),
    [
        (OTHER_WORLD, {}, "the policy chooses among"),
        (ONE_OF_THREE, {"hidden": (7,)}, "must be those that the policy was learned with"),
        (ONE_OF_THREE, {"observation": "factored"}, "must be those that the policy was learned with"),
    ],
)
def test_what_does_not_fit_is_refused_and_leaves_nothing(
    finished: RunFolder, tmp_path: Path, case: Path, changed: dict[str, object], complaint: str
) -> None:
    config = TrainingConfig.model_validate({**finished.config.model_dump(), **changed, "max_tasks": 2})
    with pytest.raises(InputError, match=complaint):
        begin_run(tmp_path / "new", load_case(case), config, finished)
    assert not (tmp_path / "new").exists()


def test_a_run_that_has_not_ended_is_no_beginning(tmp_path: Path) -> None:
    unfinished = begin_run(tmp_path / "begun", grid_case(), SMALL)
    with pytest.raises(InputError, match="training has not ended"):
        begin_run(tmp_path / "new", grid_case(), SMALL, unfinished)


def test_the_settings_are_those_of_the_source_where_none_are_given(
    finished: RunFolder, tmp_path: Path
) -> None:
    done = merap("train", ONE_OF_THREE, "-o", tmp_path / "new", "--from", finished.path, "--updates", "1")
    assert done.returncode == 0, done.stderr
    assert read_run(tmp_path / "new").config == finished.config.model_copy(update={"updates": 1})
