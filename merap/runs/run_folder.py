"""Run folders: what a training run was made from and what it has learned.

    manifest.json             kind, settings, versions, digest of the case
    case.yaml                 the case as one file
    base/<combination>.umb    the tasks, as Storm and other checkers read them
    base/index.npz            the numbers of their states
    start.safetensors         what training begins with, if that is another run's policy
    policy.safetensors        parameters, step sizes, advantages' variance
    checkpoint.safetensors    the state of training: also optimizer and generator
    metrics.csv, times.csv    a row for each update; times apart, since they never repeat
    outcome.json              how training ended, once it has
    events/                   metrics for TensorBoard, on request

The folder appears whole before training begins, and every file in it is replaced, never
written over, so that a run that is killed can go on from its last checkpoint.
"""

from __future__ import annotations

import json
import platform
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

from merap.concerns.arguments import as_path
from merap.concerns.case_study import CaseStudy
from merap.errors import InputError, OutputError
from merap.families.build import ModelBase
from merap.families.folder import MANIFEST, require_unchanged, result_folder, write_manifest
from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.mdp.short_repr import ShortRepr
from merap.runs.base_files import INDEX_FILE, archive_of, read_index, read_models, write_base

KIND = "merap training run"
# What stands in a run folder, and how; another version's is refused.
FORMAT = 3
CASE_FILE = "case.yaml"
START_FILE = "start.safetensors"
# Number of tasks that a warning names.
MOST_NAMED = 5
PACKAGES = ("merap", "torch", "stormpy", "numpy")


@dataclass(frozen=True, eq=False, repr=False)
class RunFolder(ShortRepr):
    """A training run on disk.

    Attributes:
        path: of the folder.
        case: the case it was trained for.
        config: its settings.
        names: of the N tasks, in order.
        horizons: N numbers of steps of an episode.
        cut_off: names of the tasks that can't reach their goal within the horizon.
    """

    path: Path
    case: CaseStudy
    config: TrainingConfig
    names: tuple[str, ...]
    horizons: tuple[int, ...]
    cut_off: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is allowed but probably not meant, one sentence each."""
        if not self.cut_off:
            return ()
        count, of_all = len(self.cut_off), len(self.names)
        who = "no task" if count == of_all else f"not every task ({of_all - count} of {of_all})"
        named = ", ".join(self.cut_off[:MOST_NAMED])
        rest = f" and {count - MOST_NAMED} more" if count > MOST_NAMED else ""
        within = f"{self.horizons[0]} steps" if len(set(self.horizons)) == 1 else "its horizon"
        return (f"{who} can reach its goal within {within}; cut off: {named}{rest}",)


def resume_command(path: Path) -> str:
    """Return the command line that goes on with the run in a folder."""
    return shlex.join(["merap", "train", "-o", str(path), "--resume"])


def require_free(path: Path) -> None:
    """Refuse a folder that holds something, before any work is done for it.

    Raises:
        OutputError: it does.
    """
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        other = f", or go on with: {resume_command(path)}" if (path / MANIFEST).is_file() else ""
        raise OutputError(f"{path}: exists already; choose another folder{other}")


@dataclass(frozen=True)
class Start:
    """What another run has learned, for a run that begins there.

    Attributes:
        policy: as a safetensors file.
        case: name of the case that it was learned for.
        digest: of that case.
    """

    policy: bytes = field(repr=False)
    case: str
    digest: str


def create_run(
    path: Path, case: CaseStudy, base: ModelBase, config: TrainingConfig, start: Start | None = None
) -> RunFolder:
    """Make the folder of a run that has not begun.

    Args:
        path: of the folder.
        case: to be learned.
        base: of the case.
        config: every setting.
        start: where training begins; None: at random parameters.

    Raises:
        OutputError: `path` holds something, or can't be written.
    """
    require_free(path)
    with result_folder(path, KIND) as staging:
        (staging / CASE_FILE).write_bytes(case.standalone)
        files = [CASE_FILE, *write_base(staging, base)]
        if start is not None:
            (staging / START_FILE).write_bytes(start.policy)
            files.append(START_FILE)
        content = {
            "format": FORMAT,
            "case": case.name,
            "digest": case.digest,
            "config": config.model_dump(mode="json"),
            "tasks": list(base.names),
            "horizons": list(base.horizons),
            "begun_from": None if start is None else {"case": start.case, "digest": start.digest},
            "covered": base.covered,
            "compared": base.compared,
            "cut_off": list(base.cut_off),
            "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        }
        write_manifest(staging, KIND, content, files)
    return RunFolder(path, case, config, base.names, base.horizons, base.cut_off)


def as_run(value: RunFolder | str | PathLike[str]) -> RunFolder:
    """Return a run, opened if its folder is given.

    Raises:
        InputError: it is neither, or the folder is not one of a run.
    """
    return value if isinstance(value, RunFolder) else read_run(value)


def read_run(path: str | PathLike[str]) -> RunFolder:
    """Open the folder of a run.

    Raises:
        InputError: it is not one, or its case has changed since it was made.
    """
    path = as_path(path, "run")
    content = read_manifest(path)
    try:
        config = TrainingConfig(**content["config"])
        names = tuple(str(name) for name in content["tasks"])
        horizons = tuple(int(horizon) for horizon in content["horizons"])
        cut_off = tuple(str(name) for name in content.get("cut_off", ()))
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise InputError("is not that of a training run", source=str(path / MANIFEST)) from error
    if len(names) != len(horizons):
        raise InputError("is not that of a training run", source=str(path / MANIFEST))
    require_unchanged(path, content, [CASE_FILE])
    return RunFolder(path, load_case(path / CASE_FILE), config, names, horizons, cut_off)


def read_manifest(path: Path) -> Mapping[str, Any]:
    """Return the manifest of a run's folder.

    Raises:
        InputError: there is none, or it is not that of a training run.
    """
    try:
        content = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(
            f"is not a run folder of merap: it has no readable {MANIFEST}", source=str(path)
        ) from error
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise InputError("is not a run folder of merap", source=str(path))
    if content.get("format", 1) != FORMAT:
        raise InputError(
            f"was made by another version of merap (its format is {content.get('format', 1)}, this version's "
            f"{FORMAT}); train it anew: merap train {path / CASE_FILE} -o NEW",
            source=str(path),
        )
    return content


def read_base(run: RunFolder, names: Sequence[str] | None = None) -> ModelBase:
    """Read a run's base.

    Args:
        run: the run.
        names: of some of its tasks; None: all.

    Raises:
        InputError: a file is missing, damaged or has changed.
    """
    chosen = run.names if names is None else tuple(names)
    content = read_manifest(run.path)
    require_unchanged(run.path, content, [INDEX_FILE, *map(archive_of, chosen)])
    index, kinds = read_index(run.path)
    horizon = dict(zip(run.names, run.horizons, strict=True))
    return ModelBase(
        case=run.case.name,
        digest=run.case.digest,
        names=chosen,
        index=index,
        kinds=kinds,
        models=read_models(run.path, index, chosen),
        horizons=tuple(horizon[name] for name in chosen),
        discount=run.case.discount,
        covered=int(content["covered"]),
        compared=int(content["compared"]),
        cut_off=tuple(name for name in run.cut_off if name in horizon),
    )
