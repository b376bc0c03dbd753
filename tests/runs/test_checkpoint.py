from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from merap.errors import InputError
from merap.learning.policy import shaped
from merap.learning.progress import UpdateMetrics
from merap.learning.training import meta_policy
from merap.runs.checkpoint import (
    CHECKPOINT_FILE,
    METRICS_FILE,
    POLICY_FILE,
    TIMES_FILE,
    read_checkpoint,
    read_policy,
    write_checkpoint,
    write_policy,
)
from merap.runs.metrics_file import read_metrics
from merap.runs.run_folder import RunFolder, read_run
from merap.runs.train import begin_run, tasks_of
from tests.support.trained_runs import SMALL, grid_case, trained, what_was_learned

Tensors = dict[str, Tensor]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "finished")


@pytest.fixture
def run(finished: RunFolder, tmp_path: Path) -> RunFolder:
    """A copy that may be damaged."""
    shutil.copytree(finished.path, tmp_path / "run")
    return read_run(tmp_path / "run")


def changed(path: Path, change: Callable[[Tensors], object]) -> None:
    tensors = load_file(path)
    change(tensors)
    save_file({name: value.clone() for name, value in tensors.items()}, path.with_suffix(".new"))
    path.with_suffix(".new").replace(path)


def refused(read: Callable[[], object]) -> str:
    with pytest.raises(InputError) as caught:
        read()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_reading_and_writing_changes_nothing(run: RunFolder) -> None:
    before = what_was_learned(run.path)
    tasks = tasks_of(run)
    state, metrics = read_checkpoint(run, tasks)
    (run.path / CHECKPOINT_FILE).unlink()
    (run.path / METRICS_FILE).unlink()
    write_checkpoint(run, state, metrics)
    write_policy(run, meta_policy(tasks, run.config, state))
    assert what_was_learned(run.path) == before


def test_the_state_is_that_of_the_end(finished: RunFolder) -> None:
    state, metrics = read_checkpoint(finished, tasks_of(finished))
    assert state.update == SMALL.updates == len(metrics)
    assert [row.update for row in metrics] == [1, 2, 3, 4, 5]
    policy = read_policy(finished, tasks_of(finished))
    theta = shaped(state.theta, policy.network)
    sizes = dict(zip(theta, state.log_step_sizes.exp(), strict=True))
    for name, value in policy.parameters.items():
        assert torch.equal(value, theta[name])
        assert policy.step_sizes[name].item() == sizes[name].item()
    assert state.variance is not None
    assert torch.equal(policy.variance, state.variance)
    assert policy.network.layer_sizes == (
        83,
        4,
        5,
    )  # 81 cells, the end at the goal and elsewhere; five actions
    assert policy.rule.episodes == SMALL.episodes


def test_a_run_that_has_not_begun_is_at_its_beginning(tmp_path: Path) -> None:
    run = begin_run(tmp_path / "run", grid_case(), SMALL)
    state, metrics = read_checkpoint(run, tasks_of(run))
    assert (state.update, state.variance, metrics) == (0, None, [])
    assert state.log_step_sizes.tolist() == pytest.approx([math.log(0.5)] * 4)
    assert "training has not ended" in refused(lambda: read_policy(run, tasks_of(run)))


def test_metrics_have_a_row_for_each_update_and_times_stand_apart(finished: RunFolder) -> None:
    names = [field.name for field in fields(UpdateMetrics)]
    lines = (finished.path / METRICS_FILE).read_text().splitlines()
    assert lines[0].split(",") == [name for name in names if name != "seconds"]
    assert len(lines) == 1 + SMALL.updates
    assert (finished.path / TIMES_FILE).read_text().splitlines()[0] == "update,seconds"
    rows = read_metrics(finished.path / METRICS_FILE, finished.path / TIMES_FILE)
    assert all(row.seconds > 0 and math.isfinite(row.adapted_return) for row in rows)
    # the first update goes at the full rate, the cosine falls from there
    assert rows[0].learning_rate == SMALL.learning_rate
    assert rows[-1].learning_rate < rows[0].learning_rate


@pytest.mark.parametrize("file", [CHECKPOINT_FILE, POLICY_FILE])
@pytest.mark.parametrize("length", [0, 4, 100, -1])
def test_a_file_that_is_cut_off_is_refused(run: RunFolder, file: str, length: int) -> None:
    path = run.path / file
    path.write_bytes(path.read_bytes()[:length])
    read = read_checkpoint if file == CHECKPOINT_FILE else read_policy
    assert refused(lambda: read(run, tasks_of(run))).startswith(f"{path}: can't be read: ")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("parameter.layer0.weight", torch.zeros(3, 3)),
        ("step_size.layer0.weight", torch.zeros(7)),
        ("variance", torch.zeros(2)),
        ("variance", torch.tensor(1)),
    ],
)
def test_a_policy_of_another_shape_is_refused(run: RunFolder, name: str, value: Tensor) -> None:
    changed(run.path / POLICY_FILE, lambda tensors: tensors.update({name: value}))
    line = refused(lambda: read_policy(run, tasks_of(run)))
    assert line.startswith(f"{run.path / POLICY_FILE}: {name} is ")
    assert str(list(value.shape)) in line


@pytest.mark.parametrize("name", ["parameter.layer0.weight", "step_size.layer1.bias", "variance"])
def test_a_policy_without_a_part_is_refused(run: RunFolder, name: str) -> None:
    changed(run.path / POLICY_FILE, lambda tensors: tensors.pop(name))
    assert f"{name} is missing" in refused(lambda: read_policy(run, tasks_of(run)))


@pytest.mark.parametrize(
    "name",
    [
        "theta",
        "log_step_sizes",
        "optimizer.0.exp_avg",
        "optimizer.1.step",
        "generator",
        "update",
        "variance",
    ],
)
def test_a_checkpoint_without_a_part_or_with_a_wrong_one_is_refused(run: RunFolder, name: str) -> None:
    path = run.path / CHECKPOINT_FILE
    changed(path, lambda tensors: tensors.update({name: torch.zeros(3, 1, 3)}))
    line = refused(lambda: read_checkpoint(run, tasks_of(run)))
    assert line.startswith(f"{path}: {name} is float32 [3, 1, 3], expected ")
    changed(path, lambda tensors: tensors.pop(name))
    assert f"{name} is missing" in refused(lambda: read_checkpoint(run, tasks_of(run)))


def test_a_generator_that_is_none_is_refused(run: RunFolder) -> None:
    changed(run.path / CHECKPOINT_FILE, lambda tensors: tensors["generator"].fill_(255))
    assert "generator can't be used" in refused(lambda: read_checkpoint(run, tasks_of(run)))


@pytest.mark.parametrize("update", [-1, 6])
def test_a_checkpoint_ahead_of_its_metrics_is_refused(run: RunFolder, update: int) -> None:
    changed(run.path / CHECKPOINT_FILE, lambda tensors: tensors["update"].fill_(update))
    line = refused(lambda: read_checkpoint(run, tasks_of(run)))
    assert line == f"{run.path / METRICS_FILE}: has 5 updates, the checkpoint is of update {update}"


def test_metrics_ahead_of_the_checkpoint_are_forgotten(run: RunFolder) -> None:
    """As after a kill between the two: metrics are written first."""
    changed(run.path / CHECKPOINT_FILE, lambda tensors: tensors["update"].fill_(3))
    state, metrics = read_checkpoint(run, tasks_of(run))
    assert state.update == 3
    assert [row.update for row in metrics] == [1, 2, 3]


@pytest.mark.parametrize(
    "text", ["", "update\n1\n", "update,meta_return\n1,x\n", "a,b\n1,2\n", b"\xff\xfe".decode("latin-1")]
)
@pytest.mark.parametrize("file", [METRICS_FILE, TIMES_FILE])
def test_damaged_metrics_are_refused(run: RunFolder, file: str, text: str) -> None:
    (run.path / file).write_bytes(text.encode("latin-1"))
    assert ".csv: " in refused(lambda: read_checkpoint(run, tasks_of(run)))


@pytest.mark.parametrize("file", [METRICS_FILE, TIMES_FILE])
def test_missing_metrics_are_refused(run: RunFolder, file: str) -> None:
    (run.path / file).unlink()
    assert refused(lambda: read_checkpoint(run, tasks_of(run))).startswith(
        f"{run.path / file}: can't be read"
    )
