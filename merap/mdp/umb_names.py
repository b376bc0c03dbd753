"""Give the actions and variables of a UMB archive other names, and leave all else as it is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from merap.mdp.csr import pointers_of
from merap.mdp.umb_archive import open_archive, write_archive

_INDEX = "index.json"
_ENDS, _STRINGS = "actions/choices/string-mapping.bin", "actions/choices/strings.bin"


def rename_umb(path: Path, actions: Mapping[str, str], variables: Mapping[str, str]) -> None:
    """Rename in an archive that Storm has written.

    Args:
        path: of the archive, which is replaced.
        actions: old name -> new name.
        variables: likewise.
    """
    archive = open_archive(path)
    entries: dict[str, bytes] = {name: bytes(content) for name, content in archive.entries.items()}
    ends = np.frombuffer(entries[_ENDS], dtype="<u8").tolist()
    given = [entries[_STRINGS][start:end].decode() for start, end in pairwise(ends)]
    names = [actions.get(name, name).encode() for name in given]
    entries[_STRINGS] = b"".join(names)
    lengths = np.array([len(name) for name in names], dtype=np.int64)
    entries[_ENDS] = pointers_of(lengths).astype("<u8").tobytes()
    index = json.loads(entries[_INDEX])
    for one in index["valuations"]["states"]["classes"]:
        for variable in one["variables"]:
            if "name" in variable:
                variable["name"] = variables.get(variable["name"], variable["name"])
    entries[_INDEX] = json.dumps(index).encode()
    write_archive(path, entries, overwrite=True)
