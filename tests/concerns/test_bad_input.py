"""Wrong case files: one clear line each, with file, line and key."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from tests.support.bad_cases import GENERATED, ON_THE_GRAPH, Row
from tests.support.case_examples import GRAPH, GRID, replaced, write_case


def refuse(folder: Path, text: str) -> InputError:
    with pytest.raises(InputError) as caught:
        load_declared_case(write_case(folder, text))
    return caught.value


def check_row(folder: Path, example: str, row: Row) -> None:
    old, new, marked, key, message = row
    text = replaced(example, old, new)
    error = refuse(folder, text)
    line = text[: text.index(marked)].count("\n") + 1 + marked.count("\n")
    assert error.source == str(folder / "case.yaml")
    assert error.line == line
    assert key in (error.key or "")
    assert message in error.message
    assert "\n" not in str(error)
    assert str(error).startswith(f"{folder / 'case.yaml'}:{line}: ")


@pytest.mark.parametrize("row", ON_THE_GRAPH, ids=lambda row: row[4][:40])
def test_graph(tmp_path: Path, row: Row) -> None:
    check_row(tmp_path, GRAPH, row)


@pytest.mark.parametrize("row", GENERATED, ids=lambda row: row[4][:40])
def test_grid(tmp_path: Path, row: Row) -> None:
    check_row(tmp_path, GRID, row)


SPACE_FILE = """\
locations: {S: [0, 0], G: [1, 0]}
edges:
  - [S, G, east]
  - [G, X, east]
"""
WITH_FILE = """\
case: parted
discount: 1
space: {file: floor.yaml}
environment: {configurations: {open: {}}}
capability: {actions: {east: {move: east}}, configurations: {full: {}}}
objective: {start: S, horizon: 3, configurations: {g: {}}}
"""


def test_an_error_in_a_space_file_names_that_file(tmp_path: Path) -> None:
    write_case(tmp_path, SPACE_FILE, "floor.yaml")
    error = refuse(tmp_path, WITH_FILE)
    assert error.source == str(tmp_path / "floor.yaml")
    assert error.line == 4
    assert error.key == "space.edges[1][1]"
    assert "unknown location 'X'" in error.message


@pytest.mark.parametrize(
    ("floor", "case", "source", "line", "message"),
    [
        (SPACE_FILE.replace("X", "S"), WITH_FILE.replace("floor", "flor"), "flor.yaml", None, "no such file"),
        ("file: floor.yaml\n", WITH_FILE, "floor.yaml", 1, "file stands alone in space"),
        (
            SPACE_FILE,
            WITH_FILE.replace("{file", "{attributes: {}, file"),
            "case.yaml",
            3,
            "file stands alone",
        ),
        ("locations: {S: 1}\nedges: []\n", WITH_FILE, "floor.yaml", 1, "expected a list, got 1"),
        ("edges: [\n", WITH_FILE, "floor.yaml", 2, "YAML: "),
        (SPACE_FILE, WITH_FILE.replace("floor.yaml", "[1]"), "case.yaml", 3, "expected text, got [1]"),
    ],
)
def test_wrong_space_files(
    *, tmp_path: Path, floor: str, case: str, source: str, line: int | None, message: str
) -> None:
    write_case(tmp_path, floor, "floor.yaml")
    error = refuse(tmp_path, case)
    assert (error.source, error.line) == (str(tmp_path / source), line)
    assert message in error.message


def test_the_first_of_several_errors_is_named_and_the_others_are_counted(tmp_path: Path) -> None:
    text = replaced(replaced(GRAPH, "horizon: 12", "horizon: [x]"), "discount: 1\n", "discount: y\n")
    error = refuse(tmp_path, text)
    assert error.line == 2
    assert error.message == "expected a number, got 'y' (and 1 more)"


def test_a_concern_without_actions_is_empty(tmp_path: Path) -> None:
    text = replaced(WITH_FILE, "actions: {east: {move: east}}, ", "")
    write_case(tmp_path, SPACE_FILE.replace("X", "S"), "floor.yaml")
    error = refuse(tmp_path, text)
    assert "empty concern: the capability has no action" in error.message


def test_a_support_too_large_to_filter_names_count_and_limit(tmp_path: Path) -> None:
    text = replaced(GRID, "rows: 3, cols: 3,", "rows: 30, cols: 30,")
    text = replaced(
        text,
        "choose: 2, from: {rows: [0, 1], cols: [0, 2]}",
        "choose: 3, from: {rows: [0, 29], cols: [0, 29]}",
    )
    error = refuse(tmp_path, text)
    assert error.key == "environment.configurations.require_reachable"
    # Three of the 899 cells other than the start: 899 * 898 * 897 / 6.
    assert "120691649 configurations are too many to check, the limit is 200000" in error.message
