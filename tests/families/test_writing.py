from __future__ import annotations

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from merap.checker.combination_model import build_combination
from merap.concerns.case_study import load_declared_case
from merap.errors import ModelError, OutputError
from merap.families.writing import export_case, render_case
from merap.mdp.comparison import compare
from merap.mdp.umb import read_umb
from merap.prism.rendering import render
from tests.support.paths import MODELS

CASE = load_declared_case(MODELS / "running-example")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_every_combination_is_written_once_and_twice_the_same(tmp_path: Path) -> None:
    assert render_case(CASE, CASE.combinations(), tmp_path) == 18
    written = contents(tmp_path)
    names = [f"{combination.name}.prism" for combination in CASE.combinations()]
    assert set(written) == {*names, "manifest.json"}
    first = next(CASE.combinations())
    assert written[f"{first.name}.prism"].decode() == render(first)
    manifest = json.loads(written["manifest.json"])
    assert (manifest["kind"], manifest["case"], manifest["digest"]) == ("prism", CASE.name, CASE.digest)
    assert [entry["file"] for entry in manifest["files"]] == names
    assert render_case(CASE, CASE.combinations(), tmp_path) == 18
    assert contents(tmp_path) == written


def test_exported_archives_hold_what_storm_built(tmp_path: Path) -> None:
    two = list(islice(CASE.combinations(), 2))
    assert export_case(CASE, two, tmp_path) == 2
    assert set(contents(tmp_path)) == {"manifest.json", *(f"{entry.name}.umb" for entry in two)}
    for combination in two:
        archive = read_umb(tmp_path / f"{combination.name}.umb")
        compare(archive, build_combination(combination).mdp).require_same()


def test_an_unsound_model_leaves_the_old_result_in_place(tmp_path: Path) -> None:
    first = next(CASE.combinations())
    export_case(CASE, [first], tmp_path)
    before = contents(tmp_path)
    stuck = replace(first, capability=replace(first.capability, external=(), innate=None))
    with pytest.raises(
        ModelError, match=r"state \(loc=S, mode=idle, done=false\) can be reached and has no action"
    ):
        export_case(CASE, [first, stuck], tmp_path)
    assert contents(tmp_path) == before


def test_the_two_kinds_of_result_do_not_replace_each_other(tmp_path: Path) -> None:
    render_case(CASE, islice(CASE.combinations(), 1), tmp_path)
    with pytest.raises(OutputError, match="holds something else"):
        export_case(CASE, islice(CASE.combinations(), 1), tmp_path)
