"""What the updates of a training run have shown, as rows of CSV files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from merap.errors import InputError


@dataclass(frozen=True)
class UpdateMetrics:
    """What one outer update showed.

    Attributes:
        update: counted from 1.
        meta_return: mean expected discounted return of the meta policy on the batch; by the
            sampled estimator, of its episodes.
        adapted_return: that of the policies after their inner steps.
        entropy: mean entropy of the meta policy over the steps of its episodes, in nats.
        gradient_norm: of the outer gradient, before it is cut.
        learning_rate: of the meta policy; nan for trpo.
        kl: trpo: mean divergence of the adapted policies by the step, in nats; else nan.
        step_length: trpo: part of the longest step allowed, 0 if none was accepted; else nan.
        variance: of the advantages, mean over the batch.
        seconds: wall-clock time of the update.
    """

    update: int
    meta_return: float
    adapted_return: float
    entropy: float
    gradient_norm: float
    learning_rate: float
    kl: float
    step_length: float
    variance: float
    seconds: float


TIMES = ("update", "seconds")
COLUMNS = tuple(field.name for field in fields(UpdateMetrics) if field.name != "seconds")


def csv_text(metrics: Sequence[UpdateMetrics], columns: Sequence[str]) -> str:
    """A header and a row for each update; floats are written so that they read back the same."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in metrics:
        cells = (getattr(row, name) for name in columns)
        writer.writerow("" if math.isnan(cell) else cell for cell in cells)
    return stream.getvalue()


def read_metrics(of_updates: Path, of_times: Path) -> list[UpdateMetrics]:
    """The rows of both files, as many as both have.

    Raises:
        InputError: a file is missing or damaged.
    """
    rows = []
    for row, timed in zip(_rows(of_updates), _rows(of_times), strict=False):
        try:
            values = {key: float(value or "nan") for key, value in {**row, **timed}.items()}
            rows.append(UpdateMetrics(**{**values, "update": int(row["update"])}))  # type: ignore[arg-type]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"row {len(rows) + 1} is damaged", source=str(of_updates)) from error
    return rows


def _rows(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            return list(csv.DictReader(stream))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"can't be read: {error}", source=str(path)) from error
