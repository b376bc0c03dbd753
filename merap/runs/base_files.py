"""A model base as files: an archive for each task, and the index that they are on.

The file of the index holds `valuations`, int64 [S, V], and as JSON names, kinds and completed states.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from merap.errors import InputError
from merap.families.build import ModelBase
from merap.families.observation import VariableKind
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.index import FamilyIndex
from merap.mdp.model import TabularMDP
from merap.mdp.umb import read_umb, write_umb

BASE_FOLDER = "base"
INDEX_FILE = f"{BASE_FOLDER}/index.npz"


def archive_of(name: str) -> str:
    """Return where the model of a task is."""
    return f"{BASE_FOLDER}/{name}.umb"


def write_base(folder: Path, base: ModelBase) -> list[str]:
    """Write a base into a folder of its own; return the names of the files."""
    (folder / BASE_FOLDER).mkdir()
    (folder / INDEX_FILE).write_bytes(_index_bytes(base.index, base.kinds))
    files = [INDEX_FILE]
    for name, model in zip(base.names, base.models, strict=True):
        files.append(archive_of(name))
        write_umb(restrict_to_reachable(model), folder / files[-1])
    return files


def read_models(folder: Path, index: FamilyIndex, names: Sequence[str]) -> tuple[TabularMDP, ...]:
    """Read the models of some tasks and put them on their index.

    Raises:
        InputError: an archive is missing or damaged.
    """
    return tuple(index.place(read_umb(folder / archive_of(name))) for name in names)


def _index_bytes(index: FamilyIndex, kinds: Sequence[VariableKind]) -> bytes:
    description = {
        "actions": index.actions,
        "variables": [asdict(kind) for kind in kinds],
        "completed": [[sorted(labels), number] for labels, number in index.completed.items()],
    }
    stream = io.BytesIO()
    np.savez_compressed(stream, valuations=index.valuations, description=json.dumps(description))
    return stream.getvalue()


def read_index(folder: Path) -> tuple[FamilyIndex, tuple[VariableKind, ...]]:
    """Read the index of a base, and the kinds of its variables.

    Raises:
        InputError: the file is damaged.
    """
    path = folder / INDEX_FILE
    try:
        with np.load(path) as found:
            valuations = found["valuations"]
            content = json.loads(str(found["description"]))
        kinds = tuple(VariableKind(**one) for one in content["variables"])
        completed = {frozenset(labels): int(number) for labels, number in content["completed"]}
    except (OSError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise InputError(f"can't be read: {error}", source=str(path)) from error
    names, actions = tuple(kind.name for kind in kinds), tuple(content["actions"])
    return FamilyIndex(names, valuations, completed, actions), kinds
