from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from merap.errors import InputError, MerapError, OutputError
from merap.families.build import build_base
from merap.families.loading import load_case
from merap.learning.config import TrainingConfig
from merap.mdp.comparison import compare
from merap.runs.run_folder import FORMAT, KIND, PACKAGES, RunFolder, create_run, read_base, read_run
from merap.runs.train import resume
from tests.support.paths import MODELS
from tests.support.trained_runs import SMALL, contents, grid_case, trained

RUNNING = MODELS / "running-example" / "case.yaml"
TASKS = ("open.no_entry_r3c4.middle", "open.no_entry_r4c3.middle", "open.no_entry_r3c3.middle")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "finished")


@pytest.fixture
def run(finished: RunFolder, tmp_path: Path) -> Path:
    """A copy that may be damaged."""
    shutil.copytree(finished.path, tmp_path / "run")
    return tmp_path / "run"


def manifest(run: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((run / "manifest.json").read_text())
    return found


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_run(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_a_finished_run_holds_what_the_module_says(finished: RunFolder) -> None:
    assert set(contents(finished.path)) == {
        "manifest.json",
        "case.yaml",
        "base/index.npz",
        *(f"base/{name}.umb" for name in TASKS),
        "policy.safetensors",
        "checkpoint.safetensors",
        "metrics.csv",
        "times.csv",
        "outcome.json",
    }


def test_the_manifest_says_what_it_was_made_from(finished: RunFolder) -> None:
    found = manifest(finished.path)
    assert found["kind"] == KIND
    assert found["case"] == "paper_rq1_3"
    assert found["digest"] == grid_case().digest
    assert found["tasks"] == list(TASKS)
    assert found["covered"] == found["compared"] == 3
    assert set(found["versions"]) == {"python", *PACKAGES}
    assert [entry["file"] for entry in found["files"]] == [
        "case.yaml",
        "base/index.npz",
        *(f"base/{name}.umb" for name in TASKS),
    ]
    for entry in found["files"]:
        content = (finished.path / entry["file"]).read_bytes()
        assert entry["sha256"] == hashlib.sha256(content).hexdigest()


@pytest.mark.parametrize("other", [None, 1, 2, "3"])
def test_a_run_of_another_version_is_refused_in_one_line(
    finished: RunFolder, tmp_path: Path, other: object
) -> None:
    """Runs from before formats had numbers have none."""
    run = tmp_path / "run"
    shutil.copytree(finished.path, run)
    found = manifest(run)
    assert found.pop("format") == FORMAT
    if other is not None:
        found["format"] = other
    (run / "manifest.json").write_text(json.dumps(found))
    with pytest.raises(InputError) as caught:
        read_run(run)
    line = str(caught.value)
    assert line.startswith(f"{run}: was made by another version of merap (its format is {other or 1}, ")
    assert f"merap train {run / 'case.yaml'} -o NEW" in line
    assert "\n" not in line


def test_settings_are_resolved_in_the_manifest(finished: RunFolder) -> None:
    """Every setting is there, so that later defaults change nothing."""
    config = manifest(finished.path)["config"]
    assert set(config) == set(TrainingConfig.model_fields)
    assert TrainingConfig.model_validate(config) == SMALL


def test_a_run_reads_back(finished: RunFolder) -> None:
    found = read_run(finished.path)
    assert found.config == finished.config
    assert found.names == finished.names == TASKS
    assert found.case.digest == finished.case.digest


@pytest.mark.parametrize("case", [MODELS / "paper-grid" / "rq1-3.yaml", RUNNING])
def test_the_base_reads_back_as_it_was_built(case: Path, tmp_path: Path) -> None:
    study = load_case(case)
    base = build_base(study)
    create_run(tmp_path / "run", study, base, SMALL)
    read = read_base(read_run(tmp_path / "run"))
    assert (read.names, read.kinds, read.horizons) == (base.names, base.kinds, base.horizons)
    assert (read.covered, read.compared, read.cut_off) == (base.covered, base.compared, base.cut_off)
    found = read.models
    assert len(found) == len(base.models)
    for model, built in zip(found, base.models, strict=True):
        compare(model, built).require_same()
        assert model.action_names == built.action_names
        assert model.variable_names == built.variable_names
        assert np.array_equal(model.valuations, built.valuations)
        assert np.array_equal(model.reachable, built.reachable)
        assert np.array_equal(model.enabled[model.reachable], built.enabled[built.reachable])
        assert np.array_equal(model.initial, built.initial)
        assert model.labels.keys() == built.labels.keys()


@pytest.mark.parametrize("name", ["thesis.tex", "manifest.json", ".hidden"])
def test_a_folder_that_holds_something_is_refused_and_untouched(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("years of work")
    with pytest.raises(OutputError, match="exists already"):
        trained(tmp_path)
    assert contents(tmp_path) == {name: b"years of work"}


def test_a_run_is_not_written_over(run: Path) -> None:
    before = contents(run)
    with pytest.raises(OutputError, match="--resume"):
        trained(run)
    assert contents(run) == before


def test_a_file_is_refused_as_folder(tmp_path: Path) -> None:
    path = tmp_path / "run"
    path.write_text("mine")
    with pytest.raises(OutputError):
        trained(path)
    assert path.read_text() == "mine"


def test_an_empty_folder_will_do(tmp_path: Path) -> None:
    base = build_base(grid_case())
    assert create_run(tmp_path, grid_case(), base, SMALL).names == TASKS
    assert read_run(tmp_path).names == TASKS


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", '{"kind": "prism"}', "\xff", json.dumps({"kind": KIND}), '{"kind": ' * 200_000],
    ids=["empty", "cut", "list", "null", "other kind", "not UTF-8", "kind alone", "deep"],
)
def test_rubbish_is_not_a_run(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_bytes(text.encode("latin-1"))
    refused(tmp_path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("config", {"updates": 0}),
        ("config", {"colour": "red"}),
        ("config", None),
        ("tasks", 3),
        ("tasks", None),
        ("horizons", [18]),
        ("horizons", ["long", 1, 2]),
    ],
)
def test_a_damaged_manifest_is_refused(run: Path, key: str, value: object) -> None:
    (run / "manifest.json").write_text(json.dumps({**manifest(run), key: value}))
    assert "is not that of a training run" in refused(run)


def test_what_is_no_folder_is_not_a_run(tmp_path: Path) -> None:
    refused(tmp_path / "nowhere")
    refused(tmp_path)
    (tmp_path / "file").write_text("mine")
    refused(tmp_path / "file")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("goal: [4, 4]", "goal: [4, 5]"),
        lambda text: text + "# a remark\n",
        lambda text: "case: [",
        lambda text: "",
    ],
)
def test_a_run_whose_case_was_edited_is_refused(run: Path, change: Callable[[str], str]) -> None:
    case = run / "case.yaml"
    case.write_text(change(case.read_text()))
    assert refused(run).startswith(f"{case}: has changed since this folder was made")


def test_a_run_whose_case_is_a_folder_is_refused(run: Path) -> None:
    (run / "case.yaml").unlink()
    (run / "case.yaml").mkdir()
    assert "can't be read" in refused(run)


def test_a_base_that_was_edited_is_refused(run: Path) -> None:
    """A model of another member, for example, that reads well."""
    one, other = (run / "base" / f"{name}.umb" for name in TASKS[:2])
    one.write_bytes(other.read_bytes())
    with pytest.raises(InputError, match=r"no_entry_r3c4.middle.umb: has changed since"):
        read_base(read_run(run))


def test_a_case_with_a_space_file_reads_back(tmp_path: Path) -> None:
    """The run holds both in one file."""
    text = (MODELS / "paper-grid" / "rq1-3.yaml").read_text()
    grid = "grid: {rows: 9, cols: 9, moves: {up: [-1, 0], down: [1, 0], left: [0, -1], right: [0, 1]}}"
    (tmp_path / "space.yaml").write_text(grid)
    (tmp_path / "case.yaml").write_text(text.replace(f"  {grid}", "  file: space.yaml"))
    study = load_case(tmp_path)
    create_run(tmp_path / "run", study, build_base(study), SMALL)
    assert read_run(tmp_path / "run").names == TASKS


def test_a_run_without_its_case_is_refused(run: Path) -> None:
    (run / "case.yaml").unlink()
    assert "no such file" in refused(run)


@pytest.mark.parametrize("damage", ["missing", "empty", "cut", "rubbish"])
def test_a_damaged_base_is_refused(run: Path, damage: str) -> None:
    archive = run / "base" / f"{TASKS[1]}.umb"
    content = archive.read_bytes()
    archive.unlink()
    if damage != "missing":
        replacement = {"empty": b"", "cut": content[: len(content) // 2], "rubbish": b"years of work" * 1000}
        archive.write_bytes(replacement[damage])
    with pytest.raises(InputError, match=r"r4c3\.middle\.umb") as caught:
        read_base(read_run(run))
    assert "\n" not in str(caught.value)


def test_a_run_without_tasks_is_refused(run: Path) -> None:
    (run / "manifest.json").write_text(json.dumps({**manifest(run), "tasks": [], "horizons": []}))
    with pytest.raises(MerapError, match="no model"):
        resume(run)
