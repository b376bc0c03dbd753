"""Show the figures of a bench as tables, and write them as JSON."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.table import Table

Result = TypeVar("Result")
WIDTH = 150
Json = Annotated[Path | None, typer.Option("--json", help="Write all figures.")]


def cell(value: object) -> str:
    """Return a figure for a table; a dash where there is none, or where it is infinite."""
    if value is None or value == math.inf:
        return "-"
    return (
        f"{value:.3g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else f"{value}"
    )


def table(title: str, rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> Table:
    """Build a table.

    Args:
        title: of the table.
        rows: figures by their keys.
        columns: key -> heading.
    """
    built = Table(title=title)
    for heading in columns.values():
        built.add_column(heading, no_wrap=heading in ("case", "strategy"))
    for row in rows:
        built.add_row(*(cell(row[key]) for key in columns))
    return built


def figures_by_name(title: str, figures: Mapping[str, Any]) -> Table:
    """Build a table of two columns."""
    rows = ({"figure": name, "value": value} for name, value in figures.items())
    return table(title, rows, {"figure": "figure", "value": "value"})


def show(*tables: Table | str) -> None:
    """Print tables and lines, at least `WIDTH` wide."""
    console = Console()
    console.width = max(console.width, WIDTH)
    console.print(*tables, sep="\n")


def write_figures(path: Path | None, figures: object) -> None:
    """Write figures as JSON, if a path is given."""
    if path is not None:
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


def timed(run: Callable[[], Result]) -> tuple[float, Result]:
    """Return seconds and result."""
    begin = time.perf_counter()
    result = run()
    return time.perf_counter() - begin, result
