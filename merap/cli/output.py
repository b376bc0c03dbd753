"""What every verb of the command line shares: messages, tables, progress, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn, track
from rich.table import Table

from merap.base.folder import write_file
from merap.errors import OutputError

Item = TypeVar("Item")
PIPE_WIDTH = 160

out = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else PIPE_WIDTH)
err = Console(stderr=True, highlight=False, soft_wrap=True)


def say(message: str) -> None:
    """A line of result on standard output."""
    out.print(message, markup=False)


def complain(message: str) -> None:
    """A line of error on standard error."""
    err.print(f"error: {message}", markup=False)


def warn(messages: Iterable[str]) -> None:
    """Lines of warning on standard error."""
    for message in messages:
        err.print(f"warning: {message}", markup=False)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table on standard output."""
    grid = Table(box=None, pad_edge=False, header_style="bold")
    for index, column in enumerate(columns):
        grid.add_column(column, overflow="fold", no_wrap=index == 0)
    for row in rows:
        grid.add_row(*row)
    out.print(grid)


def progress(items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
    """Pass items on, with a bar on standard error where a person watches."""
    yield from track(
        items, description=what, total=total, console=err, transient=True, disable=not err.is_terminal
    )


@contextmanager
def job_bar() -> Iterator[Progress]:
    """A bar with rate and time left on standard error, where a person watches."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} {task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        yield bar


def require_free_report(path: Path | None, *, force: bool) -> None:
    """Refuse a report that is there already, before any work is done for it."""
    if path is not None and str(path) != "-" and not force and path.exists():
        raise OutputError(f"{path}: exists already; choose another name, or write over it with --force")


def write_json(path: Path | None, content: Any, *, force: bool) -> None:
    """Write a report where `--json` asks for one; `-` is standard output."""
    if path is None:
        return
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    if str(path) == "-":
        out.out(text, end="", highlight=False)
    else:
        write_file(path, text, force=force)


def number(value: float | None, digits: int = 6) -> str:
    """A figure for a table; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}g}"
