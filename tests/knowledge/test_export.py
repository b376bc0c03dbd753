"""A recorded run as files."""

from __future__ import annotations

import csv
import json
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from merap.errors import InputError, OutputError
from merap.knowledge.base import open_knowledge
from merap.knowledge.export import export_run
from tests.support.recorded_runs import (
    EVENT,
    GOAL,
    LATE,
    RESET,
    SETTINGS,
    STEP,
    TABLE,
    UMB,
    UNSEEN,
    record_run,
)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def lines(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_all_of_a_run_is_in_the_files(knowledge_url: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with open_knowledge(knowledge_url) as knowledge:
        record_run(knowledge)
        run = record_run(knowledge)
        files = export_run(knowledge, run, out)
        place = knowledge.place
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["run"], manifest["name"], manifest["from"]) == (run, "shifts.merap", place)
    assert [entry["file"] for entry in manifest["files"]] == list(files)
    assert {path.name for path in out.iterdir()} == {*files, "manifest.json"}
    for entry in manifest["files"]:
        assert sha256((out / entry["file"]).read_bytes()).hexdigest() == entry["sha256"]
    (found,) = lines(out / "run.json")
    assert (found["id"], found["settings"], found["report"]) == (run, SETTINGS, {"utility": 3.5})
    (model,), policies = rows(out / "models.csv"), rows(out / "policies.csv")
    assert (model["name"], (out / model["file"]).read_bytes()) == ("b_blocked.speed_low.g1", UMB)
    assert [(row["kind"], row["step"], row["model"]) for row in policies] == [
        ("meta", "0", model["id"]),
        ("adapted", "1", ""),
    ]
    # equal tables are one file
    (file,) = {row["file"] for row in policies}
    np.testing.assert_array_equal(load_file(out / file)["policy"], TABLE)
    assert (out / "checkpoint.bin").read_bytes() == b"\x00state"


def test_observations_decisions_and_events_are_rows_and_lines(knowledge_url: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with open_knowledge(knowledge_url) as knowledge:
        export_run(knowledge, record_run(knowledge), out)
    observed = rows(out / "observations.csv")
    assert [float(row["reward"]) for row in observed] == [
        row.reward for row in (RESET, STEP, UNSEEN, GOAL, LATE)
    ]
    assert [row["action"] for row in observed] == ["", "1", "0", "0", "1"]
    assert [json.loads(row["valuation"]) for row in observed] == [[8, 0], [7, 0], None, [0, 8], [0, 7]]
    assert json.loads(observed[0]["detections"]) == RESET.detections
    assert [json.loads(row["enabled"]) for row in observed[:2]] == [[True, False], None]
    assert [(line["kind"], line["reasons"]) for line in lines(out / "decisions.jsonl")] == [
        ("replan", ["reward fell below 0.5", "a goal was moved"]),
        ("settled", []),
    ]
    (event,) = lines(out / "events.jsonl")
    assert event == {
        "time": "2026-11-24T18:00:00.123456+00:00",
        "component": EVENT.component,
        "level": EVENT.level,
        "message": EVENT.message,
        "data": EVENT.data,
    }


def test_an_export_replaces_an_earlier_one_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with open_knowledge(f"sqlite:///{tmp_path / 'knowledge.db'}") as knowledge:
        full, empty = record_run(knowledge), knowledge.start_run("empty", "case", "digest", {})
        export_run(knowledge, full, out)
        files = export_run(knowledge, empty, out)
        assert {path.name for path in out.iterdir()} == {*files, "manifest.json"}
        assert rows(out / "observations.csv") == []
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "thesis.tex").write_text("years of work")
        with pytest.raises(OutputError, match=r"holds something else \(thesis.tex\)"):
            export_run(knowledge, full, tmp_path / "mine")
        with pytest.raises(InputError, match="there is no run 9"):
            export_run(knowledge, 9, tmp_path / "new")
    assert not (tmp_path / "new").exists()
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.tex"]
