"""The case files of `models/`."""

from __future__ import annotations

from tests.support.paths import MODELS

CASE_FILES = sorted(
    path
    for path in MODELS.rglob("*.yaml")
    if any(line.startswith("case:") for line in path.read_text().splitlines())
)
DECLARED_CASE_FILES = [path for path in CASE_FILES if "\nprogram:" not in path.read_text()]
