"""Small training runs on the paper's grid, made in the process of the tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file

from merap.concerns.case_study import CaseStudy
from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.learning.progress import UpdateMetrics
from merap.runs.checkpoint import CHECKPOINT_FILE, METRICS_FILE, POLICY_FILE
from merap.runs.run_folder import RunFolder
from merap.runs.train import train
from tests.support.paths import MODELS

GRIDS = MODELS / "paper-grid"
ONE_OF_THREE = GRIDS / "rq1-3.yaml"
ONE_OF_SIXTEEN = GRIDS / "rq1-1.yaml"

# Where only the machinery matters and not what is learned.
SMALL = TrainingConfig(updates=5, hidden=(4,), episodes=5)


def grid_case() -> CaseStudy:
    """RQ1-3: three models."""
    return load_case(ONE_OF_THREE)


def trained(path: Path, config: TrainingConfig = SMALL, case: Path = ONE_OF_THREE) -> RunFolder:
    return train(load_case(case), path, config)


def what_was_learned(run: Path) -> Mapping[str, Any]:
    """Parameters, optimizer, generator and metrics, comparable with ==."""
    tensors = {
        f"{file}: {name}": (str(tensor.dtype), tensor.shape, tensor.tobytes())
        for file in (CHECKPOINT_FILE, POLICY_FILE)
        for name, tensor in load_file(run / file).items()
    }
    return {**tensors, METRICS_FILE: (run / METRICS_FILE).read_bytes()}


def checkpoint_update(run: Path) -> int:
    """The update that a run's checkpoint is of; 0 without one."""
    path = run / CHECKPOINT_FILE
    return int(np.asarray(load_file(path)["update"])) if path.exists() else 0


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class InterruptionError(Exception):
    """What ends training in the middle."""


def interrupt_at(update: int) -> Callable[[UpdateMetrics], None]:
    def on_update(metrics: UpdateMetrics) -> None:
        if metrics.update == update:
            raise InterruptionError

    return on_update
