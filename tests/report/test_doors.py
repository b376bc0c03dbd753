"""Doors on maps: how they are at first, and which are locked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.concerns.combination import DeclaredCombination
from merap.concerns.lookup import declared
from merap.families.loading import load_case
from merap.report.map import draw_map
from tests.support.drawings import legend_of, named, only, points

ROOMS = """\
case: rooms
discount: 1
space:
  locations: {left: [0, 0], middle: [4, 0], right: [8, 0], above: [4, 4]}
  edges:
    - [left, middle, east]
    - [middle, left, west]
    - [middle, right, east]
    - [right, middle, west]
    - [middle, above, north]
    - [above, middle, south]
  doors:
    first: {between: [left, middle], open: true}
    second: {between: [middle, right], open: false}
    third: {between: [middle, above], open: true}
environment:
  parameters: {locked: doors}
  configurations: {shut: {locked: [third]}}
capability:
  actions: {stop: {stay: 1}, east: {move: east}, west: {move: west}, north: {move: north}}
  configurations: {only: {}}
objective:
  start: left
  horizon: 9
  rewards: [{value: 1}]
  configurations: {only: {}}
"""
GRID = """\
  grid: {rows: 2, cols: 2, moves: {east: [0, 1], west: [0, -1], north: [-1, 0]}}
  doors:
    first: {between: [[0, 0], [0, 1]], open: true}
    second: {between: [[1, 0], [1, 1]], open: false}
    third: {between: [[0, 0], [1, 0]], open: true}
"""


def combination(text: str, folder: Path) -> DeclaredCombination:
    (folder / "case.yaml").write_text(text, encoding="utf-8")
    return declared(load_case(folder).combination_at(0))


def on_grid() -> str:
    first, last = ROOMS.index("  locations:"), ROOMS.index("environment:")
    return (ROOMS[:first] + GRID + ROOMS[last:]).replace("start: left", "start: [0, 0]")


@pytest.mark.parametrize(
    ("text", "first", "second", "third"),
    [(ROOMS, [2, 0], [6, 0], [4, 2]), (on_grid(), [0.5, 0], [0.5, -1], [0, -0.5])],
    ids=["graph", "grid"],
)
def test_a_door_stands_between_its_locations(
    tmp_path: Path, text: str, first: list[float], second: list[float], third: list[float]
) -> None:
    figure = draw_map(combination(text, tmp_path))
    axes = figure.axes[0]
    np.testing.assert_allclose(points(axes, "door, open at first"), [first])
    np.testing.assert_allclose(points(axes, "door, closed at first"), [second])
    np.testing.assert_allclose(points(axes, "door, locked"), [third])
    assert [text for text in legend_of(figure) if "door" in text] == [
        "door, open at first",
        "door, closed at first",
        "door, locked",
    ]


def test_a_locked_door_is_no_blocked_edge(tmp_path: Path) -> None:
    axes = draw_map(combination(ROOMS, tmp_path)).axes[0]
    assert not named(axes, "blocked edges")
    assert only(axes, "edges").get_linestyle() == [(0.0, None)]


def test_doors_on_a_graph_have_names(tmp_path: Path) -> None:
    texts = {text.get_text() for text in draw_map(combination(ROOMS, tmp_path)).axes[0].texts}
    assert texts == {"left", "middle", "right", "above", "first", "second", "third"}


def test_a_map_without_doors_speaks_of_none(tmp_path: Path) -> None:
    first, last = ROOMS.index("  doors:"), ROOMS.index("environment:")
    text = (ROOMS[:first] + ROOMS[last:]).replace("{locked: doors}", "{}").replace("{locked: [third]}", "{}")
    assert not [line for line in legend_of(draw_map(combination(text, tmp_path))) if "door" in line]
