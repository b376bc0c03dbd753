"""Folders of results: written whole or not at all, and never over something else."""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from merap.errors import InputError, OutputError

MANIFEST = "manifest.json"
STAGING = ".merap-"
# Held while files are put in their place; the thread that ends the process waits for it.
_placing = threading.RLock()
_PATIENCE = 10.0  # seconds
_unfinished: set[Path] = set()
# Another thread may still write into a folder that is being removed.
_ATTEMPTS = 10


@contextmanager
def discard_unfinished() -> Iterator[None]:
    """Wait until files are in their place, remove unfinished results, and let nothing be written inside.

    For the thread that ends the process: the others go on until they write something.
    """
    _placing.acquire(timeout=_PATIENCE)
    for staging in tuple(_unfinished):
        for _ in range(_ATTEMPTS):
            if staging.exists():
                shutil.rmtree(staging, ignore_errors=True)
    yield


@contextmanager
def result_folder(path: Path, kind: str) -> Iterator[Path]:
    """Yield an empty folder whose files take the place of those in `path` when the block succeeds.

    `path` may be absent, empty, or hold an earlier result of the same kind and nothing else.

    Args:
        path: where the result shall be.
        kind: stands in its manifest, which the block must write with `write_manifest`.

    Raises:
        OutputError: `path` holds something else, or can't be written.
    """
    with _writing(path):
        _require_replaceable(path, kind)
        staging = _nearest_folder(path) / f"{STAGING}{uuid4().hex}"
        with _placing:
            _unfinished.add(staging)
            staging.mkdir()
    try:
        with _writing(path):
            yield staging
            with _placing:
                _take_place(staging, path, kind)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        _unfinished.discard(staging)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: can't be written: {error.strerror or error}") from error


def _nearest_folder(path: Path) -> Path:
    """Return `path` itself or the nearest folder above it that exists: the same file system."""
    return next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists())


def _take_place(staging: Path, path: Path, kind: str) -> None:
    # The folder itself stays: it may be a mount, or somebody's working directory.
    path.mkdir(parents=True, exist_ok=True)
    stale = _files_of_result(path, kind)
    fresh = {entry.name for entry in staging.iterdir()}
    for name in sorted(fresh, key=lambda name: name == MANIFEST):
        (staging / name).replace(path / name)
    for name in stale - fresh:
        (path / name).unlink(missing_ok=True)


def write_manifest(folder: Path, kind: str, content: Mapping[str, Any], files: Sequence[str]) -> None:
    """Write `manifest.json`: the kind of the result, its sources, and the SHA-256 of each file."""
    entries = [{"file": name, "sha256": _digest(folder / name)} for name in files]
    manifest = {"kind": kind, **content, "files": entries}
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")


def require_unchanged(folder: Path, manifest: Mapping[str, Any], names: Iterable[str]) -> None:
    """Refuse files of a result that have changed since its manifest was written.

    Raises:
        InputError: names the first of them, or the manifest lists no files.
    """
    try:
        written = {entry["file"]: entry["sha256"] for entry in manifest["files"]}
    except (KeyError, TypeError) as error:
        raise InputError("does not list the files of the folder", source=str(folder / MANIFEST)) from error
    for name in names:
        path = folder / name
        try:
            unchanged = _digest(path) == written.get(name)
        except OSError as error:
            why = (
                "no such file" if isinstance(error, FileNotFoundError) else f"can't be read: {error.strerror}"
            )
            raise InputError(why, source=str(path)) from error
        if not unchanged:
            raise InputError(
                f"has changed since this folder was made: its SHA-256 is not that of {MANIFEST}; "
                "restore the file, or make a new folder from the changed one",
                source=str(path),
            )


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _require_replaceable(path: Path, kind: str) -> None:
    if not path.exists():
        return
    if not path.is_dir():
        raise OutputError(f"{path}: is a file, expected a folder")
    known = _files_of_result(path, kind)
    strangers = sorted(
        entry.name
        for entry in path.iterdir()
        # a folder called STAGING... is left of a run that was killed
        if not entry.name.startswith(STAGING) and not (entry.name in known and entry.is_file())
    )
    if strangers:
        raise OutputError(f"{path}: holds something else ({strangers[0]}); choose an empty folder")


def _files_of_result(path: Path, kind: str) -> set[str]:
    """Return the files of an earlier result of that kind; none if there is no such result."""
    try:
        manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
        if manifest["kind"] != kind:
            return set()
        return {MANIFEST, *(str(entry["file"]) for entry in manifest["files"])}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def write_file(path: Path, content: str, *, force: bool = False) -> None:
    """Write one file of text; see `write_bytes`."""
    write_bytes(path, content.encode(), force=force)


def write_bytes(path: Path, content: bytes, *, force: bool = False) -> None:
    """Write one file, whole or not at all.

    Raises:
        OutputError: it exists and `force` is not set, or can't be written.
    """
    with _writing(path), _placing:
        if path.is_dir():
            raise OutputError(f"{path}: is a folder, expected the name of a file")
        if path.exists() and not force:
            raise OutputError(f"{path}: exists already; choose another name or remove it")
        path.parent.mkdir(parents=True, exist_ok=True)
        staging = path.with_name(f"{STAGING}{path.name}")
        try:
            staging.write_bytes(content)
            staging.replace(path)
        except OSError:
            with suppress(OSError):
                staging.unlink()
            raise
