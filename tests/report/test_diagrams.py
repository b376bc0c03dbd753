"""Processes as state diagrams: nodes and arrows worked out by hand, and a page on which nothing overlaps."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.transforms import Bbox

from merap.families.loading import load_case
from merap.families.models import explored
from merap.report.diagrams import Arrow, Diagram, Node, process_diagrams
from merap.report.map import draw_combination
from merap.report.sheet import diagram_page
from tests.support.process_cases import SERVICE

COUNTER = """\
case: counter
discount: 1
space:
  locations: {here: [0, 0]}
  edges: []
environment: {configurations: {only: {}}}
capability:
  actions: {up: {stay: 1}, down: {stay: 1}, reset: {stay: 1}, wait: {stay: 1}}
  processes:
    count:
      range: [0, 20]
      initial: 4
      changes:
        - {action: up, where: "count < 20", set: [{value: "count + 1", probability: "count > 9 ? 0.5 : 0.25"}, {otherwise: count}]}
        - {action: down, where: "count > 0", set: "count - 1"}
        - {action: reset, set: 20}
    light: {type: bool, initial: false, changes: [{where: "count = 20", set: "!light"}]}
  configurations: {only: {}}
objective:
  start: here
  horizon: 30
  rewards: [{value: 1}]
  configurations: {only: {}}
"""  # noqa: E501


def diagrams_of(text: str, folder: Path) -> dict[str, Diagram]:
    (folder / "case.yaml").write_text(text, encoding="utf-8")
    combination = load_case(folder).combination_at(0)
    return {one.title: one for one in process_diagrams(combination, explored(combination))}


def arrows(diagram: Diagram) -> dict[tuple[str, str], tuple[str, ...]]:
    nodes = diagram.nodes
    return {(nodes[one.source].text, nodes[one.target].text): one.lines for one in diagram.arrows}


def test_variables_that_change_together_are_joint_values(tmp_path: Path) -> None:
    found = diagrams_of(SERVICE, tmp_path)
    assert list(found) == ["running, booting (servers, capability)", "load (environment)", "seen (objective)"]
    servers = found["running, booting (servers, capability)"]
    assert [node.text for node in servers.nodes] == ["1, 0", "1, 1", "2, 0", "2, 1", "3, 0", "3, 1", "4, 0"]
    assert [node.initial for node in servers.nodes] == [True, *[False] * 6]
    # booting goes on with 0.9 unless a server is given back; grow waits until it is over
    assert arrows(servers) == {
        ("1, 0", "1, 1"): ("grow",),
        ("1, 1", "2, 0"): ("keep: 0.9",),
        ("2, 0", "1, 0"): ("shrink",),
        ("2, 0", "2, 1"): ("grow",),
        ("2, 1", "1, 1"): ("shrink",),
        ("2, 1", "3, 0"): ("keep: 0.9",),
        ("3, 0", "2, 0"): ("shrink",),
        ("3, 0", "3, 1"): ("grow",),
        ("3, 1", "2, 1"): ("shrink",),
        ("3, 1", "4, 0"): ("keep: 0.9",),
        ("4, 0", "3, 0"): ("shrink",),
    }


def test_what_is_drawn_together_is_told_apart_again(tmp_path: Path) -> None:
    """`seen` reads what `load` becomes, so that the program has both in one process."""
    found = diagrams_of(SERVICE, tmp_path)
    up = {(str(load), str(load + 1)): ("any action: 0.1",) for load in range(4)}
    down = {(str(load + 1), str(load)): ("any action: 0.3",) for load in range(4)}
    assert arrows(found["load (environment)"]) == up | down
    # from load 3 it is 0.1, from a lower load 0
    assert arrows(found["seen (objective)"]) == {("never", "once"): ("any action: 0–0.1",)}


def test_the_middle_of_a_long_range_is_one_node(tmp_path: Path) -> None:
    count = diagrams_of(COUNTER, tmp_path)["count (capability)"]
    assert [node.text for node in count.nodes] == ["0", "1", "2", "3..17", "18", "19", "20"]
    assert [node.text for node in count.nodes if node.initial] == ["3..17"]
    assert count.nodes[3].notes == ("up: 0–0.5 (within)", "down: 0–1 (within)")
    assert count.nodes[6].notes == ("reset (from any)",)
    assert arrows(count) == {
        ("0", "1"): ("up: 0.25",),
        ("1", "2"): ("up: 0.25",),
        ("2", "3..17"): ("up: 0.25",),
        ("3..17", "18"): ("up: 0–0.5",),
        ("18", "19"): ("up: 0.5",),
        ("19", "20"): ("up: 0.5",),
        ("1", "0"): ("down",),
        ("2", "1"): ("down",),
        ("3..17", "2"): ("down: 0–1",),
        ("18", "3..17"): ("down",),
        ("19", "18"): ("down",),
        ("20", "19"): ("down",),
    }


def test_several_actions_may_lead_to_a_node_from_any_other(tmp_path: Path) -> None:
    text = COUNTER.replace("action: reset", "action: [reset, wait]")
    count = diagrams_of(text, tmp_path)["count (capability)"]
    assert count.nodes[6].notes == ("reset, wait (from any)",)


def test_what_all_actions_do_and_what_all_but_one_do(tmp_path: Path) -> None:
    light = diagrams_of(COUNTER, tmp_path)["light (capability)"]
    assert arrows(light)["false", "true"] == ("any action: 0–1",)
    but_wait = COUNTER.replace('{where: "count = 20"', "{action: [up, down, reset]").replace(
        "wait: {stay: 1}", "wait: {stay: 1}, a: {stay: 1}, b: {stay: 1}"
    )
    assert arrows(diagrams_of(but_wait, tmp_path)["light (capability)"])["true", "false"] == (
        "up, down, reset",
    )
    many = but_wait.replace("[up, down, reset]", "[up, down, reset, wait, a]")
    assert arrows(diagrams_of(many, tmp_path)["light (capability)"])["true", "false"] == ("any but b",)


def test_a_case_without_a_map_is_drawn_by_its_processes(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text(
        SERVICE.replace("space:\n  locations: {here: [0, 0]}\n  edges: []\n", "").replace(
            "  start: here\n", ""
        )
    )
    figure = draw_combination(load_case(tmp_path).combination_at(0), title="load and servers")
    assert [axes.get_gid() for axes in figure.axes] == ["diagram"] * 3
    assert figure.texts[0].get_text() == "load and servers"


def dense(generator: np.random.Generator) -> Diagram:
    """Eight nodes with as many arrows as they may have."""
    nodes = tuple(Node(f"value {place}", (f"note {place}",) * (place % 3), place == 0) for place in range(8))
    arrows = [
        Arrow(source, target, tuple(f"action {line}: 0.{source}{target}" for line in range(1 + source % 3)))
        for source in range(8)
        for target in range(8)
        if source != target and generator.random() < 0.5
    ]
    return Diagram("dense (environment)", nodes, tuple(arrows))


def text_boxes(axes: Axes) -> list[Bbox]:
    renderer = FigureCanvasAgg(axes.figure).get_renderer()  # type: ignore[arg-type, no-untyped-call]
    return [text.get_window_extent(renderer) for text in axes.texts]


@pytest.mark.parametrize("seed", range(4))
def test_no_text_touches_another_text_or_an_arrow(seed: int) -> None:
    figure = diagram_page("dense", [dense(np.random.default_rng(seed))])
    (axes,) = figure.axes
    boxes = text_boxes(axes)
    assert not [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])]
    lines = [patch for patch in axes.patches if patch.get_gid() == "arrow"]
    for line in lines:
        path = axes.transData.transform_path(line.get_path())
        assert not any(path.intersects_bbox(box, filled=False) for box in boxes)
    page = axes.get_window_extent()
    assert all(page.contains(*box.min) and page.contains(*box.max) for box in boxes)
