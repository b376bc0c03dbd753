"""Export a recorded run as a folder of files that other programs read.

manifest.json                  kind, run, the SHA-256 of each file
run.json                       case, settings, report, times
observations.csv               a row for each; valuation, detections and enabled as JSON
decisions.jsonl, events.jsonl  a line for each
models.csv, policies.csv       a row for each, naming its file
model-<digest>.umb, policy-<digest>.safetensors    each once, however often it was recorded
checkpoint.bin                 the last state to go on from, if there is one
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

from merap.families.folder import result_folder, write_manifest
from merap.knowledge.base import KnowledgeBase
from merap.knowledge.rows import DecisionRow, EventRow, ObservationRow, RunRow

KIND = "merap recorded run"
OBSERVATION_COLUMNS = (
    "episode",
    "step",
    "action",
    "reward",
    "continuation",
    "truncated",
    "valuation",
    "detections",
    "enabled",
)
SHOWN_DIGEST = 16


def export_run(knowledge: KnowledgeBase, run: int, path: str | PathLike[str]) -> tuple[str, ...]:
    """Write a run to a folder, whole or not at all.

    Args:
        knowledge: where it is.
        run: its number.
        path: absent, empty, or an earlier export.

    Returns:
        The names of the files but for the manifest.

    Raises:
        InputError: there is no such run.
        OutputError: the folder holds something else, or can't be written.
    """
    found = knowledge.run(run)
    with result_folder(Path(path), KIND) as folder:
        _write_lines(folder / "run.json", [run_record(found)])
        _write_observations(folder / "observations.csv", knowledge.observations(run))
        _write_lines(folder / "decisions.jsonl", map(decision_record, knowledge.decisions(run)))
        _write_lines(folder / "events.jsonl", map(event_record, knowledge.events(run)))
        models = [
            {**asdict(row), "file": _write_blob(knowledge, folder, "model-{}.umb", row.digest)}
            for row in knowledge.models(run)
        ]
        _write_rows(folder / "models.csv", ("id", "name", "digest", "file"), models)
        policies = [
            {**asdict(row), "file": _write_blob(knowledge, folder, "policy-{}.safetensors", row.digest)}
            for row in knowledge.policies(run)
        ]
        _write_rows(folder / "policies.csv", ("id", "kind", "step", "model", "digest", "file"), policies)
        checkpoint = knowledge.latest_checkpoint(run)
        if checkpoint is not None:
            (folder / "checkpoint.bin").write_bytes(checkpoint.state)
        files = tuple(sorted(entry.name for entry in folder.iterdir()))
        content = {"run": run, "name": found.name, "case": found.case, "from": knowledge.place}
        write_manifest(folder, KIND, content, files)
    return files


def run_record(row: RunRow) -> dict[str, Any]:
    """Put a run in JSON's terms."""
    finished = None if row.finished is None else row.finished.isoformat()
    return {**asdict(row), "started": row.started.isoformat(), "finished": finished}


def decision_record(row: DecisionRow) -> dict[str, Any]:
    """Put a decision in JSON's terms."""
    return {**asdict(row), "reasons": list(row.reasons)}


def event_record(row: EventRow) -> dict[str, Any]:
    """Put a line of the log in JSON's terms."""
    return {**asdict(row), "time": row.time.isoformat(timespec="microseconds")}


def observation_record(row: ObservationRow) -> dict[str, Any]:
    """Put an observation in JSON's terms."""
    return {name: getattr(row, name) for name in OBSERVATION_COLUMNS}


def _write_observations(path: Path, rows: Iterable[ObservationRow]) -> None:
    records = map(observation_record, rows)
    nested = OBSERVATION_COLUMNS[-3:]
    _write_rows(
        path,
        OBSERVATION_COLUMNS,
        ({**record, **{name: json.dumps(record[name]) for name in nested}} for record in records),
    )


def _write_blob(knowledge: KnowledgeBase, folder: Path, pattern: str, digest: str) -> str:
    name = pattern.format(digest[:SHOWN_DIGEST])
    if not (folder / name).exists():
        (folder / name).write_bytes(knowledge.blob(digest))
    return name


def _write_lines(path: Path, records: Iterable[Mapping[str, Any]]) -> None:
    with path.open("w", encoding="utf-8") as stream:
        stream.writelines(json.dumps(record) + "\n" for record in records)


def _write_rows(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
