"""Metrics for TensorBoard, an optional extra."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from merap.errors import InputError
from merap.learning.progress import UpdateMetrics

Log = Callable[[UpdateMetrics], None]


@contextmanager
def event_log(folder: Path, first_update: int) -> Iterator[Log]:
    """Write metrics as event files; those of later updates, from an interrupted run, are purged.

    Args:
        folder: of the files.
        first_update: that will be written.

    Raises:
        InputError: TensorBoard is missing.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415  it takes seconds
    except ModuleNotFoundError as error:
        raise InputError(
            "tensorboard=true needs TensorBoard, which is missing: pip install 'merap[tensorboard]'"
        ) from error

    with SummaryWriter(str(folder), purge_step=first_update) as writer:

        def log(metrics: UpdateMetrics) -> None:
            for name, value in asdict(metrics).items():
                if name != "update" and not math.isnan(value):
                    writer.add_scalar(name, value, metrics.update)

        yield log
