"""A training run's state on disk: enough to go on bit for bit, and what it has learned."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from merap.errors import InputError
from merap.families.folder import write_bytes, write_file
from merap.learning.meta import MetaPolicy, step_rule
from merap.learning.policy import Parameters
from merap.learning.progress import Progress, UpdateMetrics
from merap.learning.tasks import TaskBatch
from merap.learning.training import Best, TrainingState, initial_state, policy_network
from merap.runs.metrics_file import COLUMNS, TIMES, csv_text, read_metrics
from merap.runs.run_folder import START_FILE, RunFolder, resume_command
from merap.runs.warm_start import begun_from

POLICY_FILE = "policy.safetensors"
CHECKPOINT_FILE = "checkpoint.safetensors"
METRICS_FILE = "metrics.csv"
TIMES_FILE = "times.csv"
_PARAMETER = "parameter."
_STEP_SIZE = "step_size."
_THETA = "theta"
_LOG_STEP_SIZES = "log_step_sizes"
_OPTIMIZER = "optimizer."
_VARIANCE = "variance"
_GENERATOR = "generator"
_UPDATE = "update"
_BEST = "best."


def write_policy(run: RunFolder, policy: MetaPolicy) -> None:
    """Write what a run has learned."""
    write_bytes(run.path / POLICY_FILE, policy_bytes(policy), force=True)


def policy_bytes(policy: MetaPolicy) -> bytes:
    """Return a meta policy as a safetensors file."""
    tensors = {
        **_prefixed(_PARAMETER, policy.parameters),
        **_prefixed(_STEP_SIZE, policy.step_sizes),
        _VARIANCE: policy.variance,
    }
    return save(tensors)


def read_policy(run: RunFolder, tasks: TaskBatch, file: str = POLICY_FILE) -> MetaPolicy:
    """Read what a run has learned, or with `START_FILE` where it began.

    Raises:
        InputError: training has not ended, or the file does not fit.
    """
    path = run.path / file
    tensors = _load(path, f"training has not ended; go on with: {resume_command(run.path)}")
    network = policy_network(tasks, run.config)
    parameters = {name: torch.zeros(shape) for name, shape in network.parameter_shapes.items()}
    step_sizes = {name: torch.zeros((1,) * value.dim()) for name, value in parameters.items()}
    return MetaPolicy(
        network=network,
        parameters=_taken(tensors, _PARAMETER, parameters, path),
        step_sizes=_taken(tensors, _STEP_SIZE, step_sizes, path),
        variance=_taken(tensors, "", {_VARIANCE: torch.zeros(())}, path)[_VARIANCE],
        rule=step_rule(run.config, tasks.discount),
    )


def write_checkpoint(run: RunFolder, state: TrainingState, metrics: Sequence[UpdateMetrics]) -> None:
    """Write the state of training and its metrics so far."""
    tensors = {
        _THETA: state.theta,
        _LOG_STEP_SIZES: state.log_step_sizes,
        **_prefixed(_OPTIMIZER, state.optimizer.state_dict()),
        _GENERATOR: state.generator.get_state(),
        _UPDATE: torch.tensor(state.update),
    }
    if state.variance is not None:
        tensors[_VARIANCE] = state.variance
    if state.best is not None:
        tensors |= _prefixed(_BEST, vars(state.best))
    write_file(run.path / METRICS_FILE, csv_text(metrics, COLUMNS), force=True)
    write_file(run.path / TIMES_FILE, csv_text(metrics, TIMES), force=True)
    # last, so that metrics are never behind it
    write_bytes(run.path / CHECKPOINT_FILE, save(tensors), force=True)


def read_checkpoint(run: RunFolder, tasks: TaskBatch) -> tuple[TrainingState, list[UpdateMetrics]]:
    """Read the state a run can go on from, and its metrics up to there; the initial one if it has none.

    The initial one is that of another run where there is a `START_FILE`.

    Raises:
        InputError: the files don't fit.
    """
    if (run.path / START_FILE).exists():
        state = begun_from(read_policy(run, tasks, START_FILE), tasks, run.config)
    else:
        state = initial_state(policy_network(tasks, run.config), run.config)
    path = run.path / CHECKPOINT_FILE
    if not path.exists():
        return state, []
    tensors = _load(path, "is missing")
    like = {
        _THETA: state.theta,
        _LOG_STEP_SIZES: state.log_step_sizes,
        _UPDATE: torch.tensor(0),
        _VARIANCE: torch.zeros(()),
        _GENERATOR: state.generator.get_state(),
    }
    found = _taken(tensors, "", like, path)
    state.theta.copy_(found[_THETA])
    state.log_step_sizes.copy_(found[_LOG_STEP_SIZES])
    state.update, state.variance = int(found[_UPDATE]), found[_VARIANCE]
    try:
        state.generator.set_state(found[_GENERATOR])
    except RuntimeError as error:
        raise InputError(f"{_GENERATOR} can't be used: {error}", source=str(path)) from error
    state.optimizer.load_state_dict(_taken(tensors, _OPTIMIZER, state.optimizer.state_dict(), path))
    metrics = read_metrics(run.path / METRICS_FILE, run.path / TIMES_FILE)
    if not 0 <= state.update <= len(metrics):
        raise InputError(
            f"has {len(metrics)} updates, the checkpoint is of update {state.update}",
            source=str(run.path / METRICS_FILE),
        )
    metrics = metrics[: state.update]
    state.progress = Progress([row.adapted_return for row in metrics], run.config.least_gain)
    if state.progress.best_update:
        best = {name: like[name] for name in (_THETA, _LOG_STEP_SIZES, _VARIANCE)}
        state.best = Best(**_taken(tensors, _BEST, best, path))
    return state, metrics


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
