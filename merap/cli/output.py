"""Show messages, tables, progress and JSON, for every verb of the command line."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from merap.errors import InputError, OutputError
from merap.families.folder import write_file
from merap.masking import masked

Item = TypeVar("Item")
PIPE_WIDTH = 160
# Of plain lines of progress, in seconds.
FIRST_LINE_AFTER, LONGEST_WAIT = 1.0, 30.0

out = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else PIPE_WIDTH)
err = Console(stderr=True, highlight=False, soft_wrap=True)


def say(message: str) -> None:
    """Print a line of result on standard output."""
    out.print(message, markup=False)


def complain(message: str) -> None:
    """Print a line of error on standard error, without secrets that were typed in a wrong place."""
    err.print(f"error: {masked(message)}", markup=False)


def warn(messages: Iterable[str]) -> None:
    """Print lines of warning on standard error."""
    for message in messages:
        err.print(f"warning: {message}", markup=False)


def require_verb(context: typer.Context) -> None:
    """Show the help of a group of verbs that was called without one, and exit as for wrong usage."""
    if context.invoked_subcommand is None:
        say(context.get_help())
        raise typer.Exit(InputError.exit_code)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on standard output; no character of a cell is a command."""
    grid = Table(box=None, pad_edge=False, header_style="bold")
    for index, column in enumerate(columns):
        grid.add_column(column, overflow="fold", no_wrap=index == 0)
    for row in rows:
        grid.add_row(*map(Text, row))
    out.print(grid)


class Job:
    """A job's progress on standard error: a bar on a terminal, else a plain line now and then.

    The first line comes after a second, the others at growing distances.
    """

    def __init__(self, bar: Progress, name: str, total: int) -> None:
        self._bar, self._name, self._total = bar, name, total
        self._task = bar.add_task(name, total=total, note="")
        self._done, self._told = 0, False
        self._wait = FIRST_LINE_AFTER
        self._due = time.monotonic() + self._wait

    def advance(self, done: int | None = None, note: str = "") -> None:
        """Show that one more part is done, or how many are."""
        self.draw(self._done + 1 if done is None else done, note)
        finished = self._done >= self._total
        if err.is_terminal or not (self._told if finished else time.monotonic() >= self._due):
            return
        err.print(f"{self._name}: {self._done} of {self._total}{note and f', {note}'}", markup=False)
        self._told = True
        self._wait = min(2 * self._wait, LONGEST_WAIT)
        self._due = time.monotonic() + self._wait

    def draw(self, done: int, note: str = "") -> None:
        """Show on a terminal alone how many parts are done."""
        self._done = done
        self._bar.update(self._task, completed=done, note=note)


@contextmanager
def job(name: str, total: int) -> Iterator[Job]:
    """Show the progress of a job inside."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} {task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        yield Job(bar, name, total)


def progress(items: Iterable[Item], total: int, name: str) -> Iterator[Item]:
    """Pass items on, and show how many there were."""
    with job(name, total) as shown:
        for item in items:
            yield item
            shown.advance()


def progress_line(message: str) -> None:
    """Print a line of progress on standard error, where no person watches a bar."""
    if not err.is_terminal:
        err.print(message, markup=False)


def require_free_report(path: Path | None, *, force: bool) -> None:
    """Refuse a file that is there already, or can't be written, before any work is done for it.

    Its folder must be there: only the folders of `--out` and of runs are made.
    """
    if path is None or str(path) == "-":
        return
    if path.is_dir():
        raise OutputError(f"{path}: is a folder, expected the name of a file")
    if not force and path.exists():
        raise OutputError(f"{path}: exists already; choose another name, or write over it with --force")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: there is no folder {path.parent}; make it first")
    _require_writable(path.parent, path)


def require_free_folder(folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Refuse a folder that holds one of the files, or can't be written, before any work is done for it."""
    for name in names:
        if (folder / name).exists() and not force:
            raise OutputError(f"{folder / name}: exists already; choose another folder, or use --force")
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise OutputError(f"{folder}: {there} is a file, expected a folder")
    _require_writable(there, folder)


def _require_writable(folder: Path, path: Path) -> None:
    try:
        with TemporaryFile(dir=folder):
            return
    except OSError as error:
        raise OutputError(f"{path}: can't be written: {error.strerror or error}") from error


def write_json(path: Path | None, content: Any, *, force: bool) -> None:
    """Write a report where `--json` asks for one; `-` is standard output."""
    if path is None:
        return
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    if str(path) == "-":
        out.out(text, end="", highlight=False)
    else:
        write_file(path, text, force=force)


def counted(count: float, noun: str) -> str:
    """Return a number with its noun: 1 seed, 2 seeds."""
    text = str(count) if isinstance(count, int) else f"{count:g}"
    return f"{text} {noun}" if count == 1 else f"{text} {noun}s"


def number(value: float | None, digits: int = 6) -> str:
    """Format a figure for a table; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}g}"
