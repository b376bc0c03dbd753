"""The metrics of updates as CSV files; times stand apart, since they never repeat."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from merap.errors import InputError
from merap.learning.progress import UpdateMetrics

TIMES = ("update", "seconds")
COLUMNS = tuple(field.name for field in fields(UpdateMetrics) if field.name != "seconds")


def csv_text(metrics: Sequence[UpdateMetrics], columns: Sequence[str]) -> str:
    """Return a header and a row for each update; floats are written so that they read back the same."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in metrics:
        cells = (getattr(row, name) for name in columns)
        writer.writerow("" if math.isnan(cell) else cell for cell in cells)
    return stream.getvalue()


def read_metrics(of_updates: Path, of_times: Path) -> list[UpdateMetrics]:
    """Read the rows of both files, as many as both have.

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
