"""The worked example of the UMB standard, and archives made of it by another route."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

Entries = dict[str, bytes]
Index = dict[str, Any]


def words(*values: int) -> bytes:
    return np.array(values, dtype="<u8").tobytes()


def doubles(*values: float) -> bytes:
    return np.array(values, dtype="<f8").tobytes()


def standard_example() -> tuple[Index, Entries]:
    """Return the worked example of the UMB standard (example/README.md), byte by byte as it lists them."""
    index: Index = {
        "format-version": 1,
        "format-revision": 0,
        "model-data": {},
        "file-data": {"tool": "PRISM", "tool-version": "4.10"},
        "transition-system": {
            "time": "discrete",
            "#players": 1,
            "#states": 4,
            "#initial-states": 1,
            "#choices": 5,
            "#choice-actions": 2,
            "#branches": 8,
            "#branch-actions": 0,
            "#observations": 0,
            "branch-probability-type": {"type": "double", "size": 64},
        },
        "annotations": {
            "aps": {"g": {"alias": "g", "applies-to": ["states"], "type": {"type": "bool", "size": 1}}},
            "rewards": {"r": {"alias": "r", "applies-to": ["choices"], "type": {"type": "double"}}},
        },
        "valuations": {
            "states": {
                "unique": True,
                "classes": [
                    {
                        "variables": [
                            {"name": "x", "type": {"type": "uint", "size": 2}},
                            {"name": "b", "type": {"type": "bool"}},
                            {"padding": 5},
                        ]
                    }
                ],
            }
        },
    }
    entries = {
        "state-to-choices.bin": words(0, 2, 3, 4, 5),
        "choice-to-branches.bin": words(0, 2, 4, 6, 7, 8),
        "branch-to-probability.bin": doubles(0.5, 0.5, 0.2, 0.8, 0.9, 0.1, 1, 1),
        "branch-to-target.bin": words(1, 2, 2, 3, 0, 1, 2, 3),
        "state-is-initial.bin": words(0b0001),
        "actions/choices/string-mapping.bin": words(0, 1, 2),
        "actions/choices/strings.bin": b"ab",
        "actions/choices/values.bin": np.array([0, 1, 0, 0, 0], dtype="<u4").tobytes(),
        "annotations/aps/g/states/values.bin": words(0b1000),
        "annotations/rewards/r/choices/values.bin": doubles(0, 1, 0, 0, 0),
        "valuations/states/valuations.bin": bytes([0b000, 0b001, 0b010, 0b110]),
    }
    return index, entries


def tar_bytes(index: Index | bytes, entries: Mapping[str, bytes]) -> bytes:
    """Return a tar file by another route than the one under test."""
    buffer = io.BytesIO()
    content = index if isinstance(index, bytes) else json.dumps(index).encode()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name, data in {"index.json": content, **entries}.items():
            header = tarfile.TarInfo(name)
            header.size = len(data)
            tar.addfile(header, io.BytesIO(data))
    return buffer.getvalue()


def saved(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path
