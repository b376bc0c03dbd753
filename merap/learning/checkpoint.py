"""A training run's state on disk: enough to go on bit for bit, and what it has learned."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from merap.base.folder import write_bytes
from merap.errors import InputError
from merap.learning.meta import MetaPolicy, step_rule
from merap.learning.policy import Parameters
from merap.learning.run_folder import RunFolder
from merap.learning.tasks import TaskBatch
from merap.learning.training import TrainingState, UpdateMetrics, initial_state, policy_network

POLICY_FILE = "policy.safetensors"
CHECKPOINT_FILE = "checkpoint.safetensors"
METRICS_FILE = "metrics.csv"
TIMES_FILE = "times.csv"
_PARAMETER = "parameter."
_STEP_SIZE = "step_size."
_LOG_STEP_SIZE = "log_step_size."
_OPTIMIZER = "optimizer."
_VARIANCE = "variance"
_GENERATOR = "generator"
_UPDATE = "update"


def write_policy(run: RunFolder, policy: MetaPolicy) -> None:
    """Write what a run has learned."""
    tensors = {
        **_prefixed(_PARAMETER, policy.parameters),
        **_prefixed(_STEP_SIZE, policy.step_sizes),
        _VARIANCE: policy.variance,
    }
    write_bytes(run.path / POLICY_FILE, save(tensors), force=True)


def read_policy(run: RunFolder, tasks: TaskBatch) -> MetaPolicy:
    """Read what a run has learned.

    Raises:
        InputError: training has not ended, or the file does not fit.
    """
    path = run.path / POLICY_FILE
    tensors = _load(path, "training has not ended; go on with `merap train --resume`")
    network = policy_network(tasks, run.config)
    fresh = initial_state(network, run.config)
    return MetaPolicy(
        network=network,
        parameters=_taken(tensors, _PARAMETER, fresh.parameters, path),
        step_sizes=_taken(tensors, _STEP_SIZE, fresh.log_step_sizes, path),
        variance=_taken(tensors, "", {_VARIANCE: torch.zeros(())}, path)[_VARIANCE],
        rule=step_rule(run.config, tasks.discount),
    )


def write_checkpoint(run: RunFolder, state: TrainingState, metrics: Sequence[UpdateMetrics]) -> None:
    """Write the state of training and its metrics so far."""
    optimizer = {
        f"{_OPTIMIZER}{index}.{name}": value
        for index, entries in state.optimizer.state_dict()["state"].items()
        for name, value in entries.items()
    }
    tensors = {
        **_prefixed(_PARAMETER, state.parameters),
        **_prefixed(_LOG_STEP_SIZE, state.log_step_sizes),
        **optimizer,
        _GENERATOR: state.generator.get_state(),
        _UPDATE: torch.tensor(state.update),
    }
    if state.variance is not None:
        tensors[_VARIANCE] = state.variance
    write_bytes(run.path / METRICS_FILE, _csv(metrics, leave_out="seconds"), force=True)
    write_bytes(run.path / TIMES_FILE, _csv(metrics, only=("update", "seconds")), force=True)
    # last, so that metrics are never behind it
    write_bytes(run.path / CHECKPOINT_FILE, save(tensors), force=True)


def read_checkpoint(run: RunFolder, tasks: TaskBatch) -> tuple[TrainingState, list[UpdateMetrics]]:
    """The state a run can go on from, and its metrics up to there; the initial one if it has none.

    Raises:
        InputError: the files don't fit.
    """
    state = initial_state(policy_network(tasks, run.config), run.config)
    path = run.path / CHECKPOINT_FILE
    if not path.exists():
        return state, []
    tensors = _load(path, "is missing")
    with torch.no_grad():
        for prefix, leaves in ((_PARAMETER, state.parameters), (_LOG_STEP_SIZE, state.log_step_sizes)):
            for name, value in _taken(tensors, prefix, leaves, path).items():
                leaves[name].copy_(value)
    counted = {_UPDATE: torch.tensor(0), _VARIANCE: torch.zeros(()), _GENERATOR: state.generator.get_state()}
    found = _taken(tensors, "", counted, path)
    state.update, state.variance = int(found[_UPDATE]), found[_VARIANCE]
    try:
        state.generator.set_state(found[_GENERATOR])
    except RuntimeError as error:
        raise InputError(f"{_GENERATOR} can't be used: {error}", source=str(path)) from error
    state.optimizer.load_state_dict(
        {
            **state.optimizer.state_dict(),
            "state": _optimizer_state(tensors, state, path),
        }  # groups are of the config
    )
    metrics = read_metrics(run)
    if not 0 <= state.update <= len(metrics):
        raise InputError(
            f"has {len(metrics)} updates, the checkpoint is of update {state.update}",
            source=str(run.path / METRICS_FILE),
        )
    return state, metrics[: state.update]


def _optimizer_state(tensors: Parameters, state: TrainingState, path: Path) -> dict[int, dict[str, Tensor]]:
    """Adam's moments for each leaf, by its number."""
    leaves = (*state.parameters.values(), *state.log_step_sizes.values())
    return {
        index: _taken(
            tensors,
            f"{_OPTIMIZER}{index}.",
            {"step": torch.zeros(()), "exp_avg": leaf, "exp_avg_sq": leaf},
            path,
        )
        for index, leaf in enumerate(leaves)
    }


def read_metrics(run: RunFolder) -> list[UpdateMetrics]:
    """The metrics of every update up to the last checkpoint, and maybe of some after it.

    Raises:
        InputError: a file is missing or damaged.
    """
    rows = []
    timed_rows = _rows(run.path / TIMES_FILE)
    for row, timed in zip(_rows(run.path / METRICS_FILE), timed_rows, strict=False):
        try:
            values = {key: float(value) for key, value in {**row, **timed}.items()}
            rows.append(UpdateMetrics(**{**values, "update": int(row["update"])}))  # type: ignore[arg-type]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"row {len(rows) + 1} is damaged", source=str(run.path / METRICS_FILE)
            ) from error
    return rows


def _rows(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            return list(csv.DictReader(stream))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"can't be read: {error}", source=str(path)) from error


def _csv(
    metrics: Sequence[UpdateMetrics], *, leave_out: str | None = None, only: Sequence[str] | None = None
) -> bytes:
    names = [field.name for field in fields(UpdateMetrics) if field.name != leave_out]
    columns = list(only) if only is not None else names
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([getattr(row, name) for name in columns] for row in metrics)
    return stream.getvalue().encode()


def _prefixed(prefix: str, tensors: Parameters) -> Parameters:
    return {prefix + name: value.detach().contiguous() for name, value in tensors.items()}


def _taken(tensors: Parameters, prefix: str, like: Parameters, path: Path) -> Parameters:
    for name, value in like.items():
        found = tensors.get(prefix + name)
        if found is None or found.shape != value.shape or found.dtype != value.dtype:
            kind = "missing" if found is None else _kind(found)
            raise InputError(f"{prefix + name} is {kind}, expected {_kind(value)}", source=str(path))
    return {name: tensors[prefix + name] for name in like}


def _kind(tensor: Tensor) -> str:
    return f"{str(tensor.dtype).removeprefix('torch.')} {list(tensor.shape)}"


def _load(path: Path, missing: str) -> Parameters:
    if not path.exists():
        raise InputError(missing, source=str(path))
    try:
        return load_file(path)
    except (SafetensorError, OSError) as error:
        raise InputError(f"can't be read: {error}", source=str(path)) from error
