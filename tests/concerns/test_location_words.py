"""The words `at`, `row`, `col` and `moved` in every expression that may read the location."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.combination_model import build_combination
from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from merap.mdp.comparison import compare
from merap.mdp.model import Floats, TabularMDP
from merap.program.arrays import tabular
from merap.program.exploration import explore
from tests.support.case_examples import GRAPH, GRID, replaced, write_case


def explored(folder: Path, text: str, member: str) -> TabularMDP:
    """Return the model of a member, on which both routes agree."""
    combination = load_declared_case(write_case(folder, text)).combination(member)
    program = combination.program
    mdp = tabular(program, explore(program), reward="objective")
    compare(build_combination(combination).mdp, mdp).require_same()
    return mdp


def expected_rewards(mdp: TabularMDP, value: Floats) -> Floats:
    """float64 [C]: the expectation of a value of every branch (float64 [B]); `end` earns nothing."""
    total = np.zeros(len(mdp.choice_state))
    np.add.at(total, mdp.branch_choice, mdp.branch_prob * value)
    return np.where(mdp.labels["done"][mdp.choice_state], 0.0, total)


RULES = GRAPH[GRAPH.index("  rewards:") : GRAPH.index("  ends_in:")]


def graph(rule: str) -> str:
    return replaced(GRAPH, RULES, f"  rewards:\n    - {rule}\n")


@pytest.mark.parametrize("member", ["open.slow.g", "open.slow.ab", "dim.fast.ab"])
@pytest.mark.parametrize(
    ("value", "here", "there"),
    [
        ("at(A) ? 2 : 1", "A", ""),
        ("at([S, B]) ? 2 : 1", "SB", ""),
        ("at'(G) ? 2 : 1", "", "G"),
        ("at'([G]) & at(A) ? 2 : 1", "A", "G"),
    ],
)
def test_rewards_say_where_a_step_begins_and_leads(
    tmp_path: Path, member: str, value: str, here: str, there: str
) -> None:
    mdp = explored(tmp_path, graph(f'{{value: "{value}"}}'), member)
    loc = mdp.valuations[:, mdp.variable_names.index("loc")]
    source, target = loc[mdp.choice_state[mdp.branch_choice]], loc[mdp.branch_target]
    holds = np.ones(len(source), dtype=np.bool_)
    for places, column in ((here, source), (there, target)):
        if places:
            holds &= np.isin(column, ["SABG".index(place) for place in places])
    assert mdp.choice_reward == pytest.approx(expected_rewards(mdp, np.where(holds, 2.0, 1.0)))
    assert mdp.choice_reward.max() > 1


def test_a_parameter_holds_locations(tmp_path: Path) -> None:
    for member, places in (("open.slow.g", [3]), ("open.slow.ab", [1, 2])):
        mdp = explored(tmp_path, graph("{where: at(goal), value: 3}"), member)
        loc = mdp.valuations[:, mdp.variable_names.index("loc")]
        value = np.where(np.isin(loc[mdp.choice_state[mdp.branch_choice]], places), 3.0, 0.0)
        assert mdp.choice_reward == pytest.approx(expected_rewards(mdp, value))


def test_whether_a_step_moves(tmp_path: Path) -> None:
    mdp = explored(tmp_path, graph("{where: moved, value: 1}"), "dim.slow.g")
    loc = mdp.valuations[:, mdp.variable_names.index("loc")]
    value = (loc[mdp.choice_state[mdp.branch_choice]] != loc[mdp.branch_target]).astype(np.float64)
    assert mdp.choice_reward == pytest.approx(expected_rewards(mdp, value))


CELLS = replaced(GRID, "    - {value: -0.5}", '    - {value: "VALUE"}')


@pytest.mark.parametrize(
    ("value", "by_hand"),
    [
        ("10 * row + col", lambda row, col, row_, col_: 10 * row + col),
        ("row' - row + 0.5 * col'", lambda row, col, row_, col_: row_ - row + 0.5 * col_),
        ("moved ? 1 : 0", lambda row, col, row_, col_: (row != row_) | (col != col_)),
        ("at([1, 2]) ? 1 : 0", lambda row, col, row_, col_: (row == 1) & (col == 2)),
        ("at'([[1, 2], [0, 1], r2c2]) ? 1 : 0",
         lambda row, col, row_, col_: np.isin(3 * row_ + col_, [1, 5, 8])),
        ("at(goal) | at([0, 0]) ? 1 : 0", lambda row, col, row_, col_: np.isin(3 * row + col, [0, 8])),
    ],
)  # fmt: skip
def test_cells_of_a_grid(tmp_path: Path, value: str, by_hand: object) -> None:
    mdp = explored(
        tmp_path, CELLS.replace("VALUE", value).replace("    - {at: goal, action: stop, value: 10}\n", ""),
        "blocked_r1c0_r1c2.no_entry_r2c0.goal_r2c2",
    )  # fmt: skip
    row, col = (mdp.valuations[:, mdp.variable_names.index(name)] for name in ("row", "col"))
    source, target = mdp.choice_state[mdp.branch_choice], mdp.branch_target
    assert callable(by_hand)
    expected = np.asarray(by_hand(row[source], col[source], row[target], col[target]), dtype=np.float64)
    assert mdp.choice_reward == pytest.approx(expected_rewards(mdp, expected))


def test_probabilities_and_conditions_of_actions_read_the_location(tmp_path: Path) -> None:
    text = replaced(GRID, "up: {move: up}", 'up: {move: up, probability: "at([1, 1]) ? 0.5 : 1"}')
    text = replaced(text, "left: {move: left}", 'left: {move: left, requires: "col > 1 | row = 2"}')
    mdp = explored(tmp_path, text, "blocked_r1c0_r1c2.no_entry_r2c0.goal_r2c2")
    row, col = (mdp.valuations[:, mdp.variable_names.index(name)] for name in ("row", "col"))
    going = ~mdp.labels["done"]
    left = mdp.enabled[:, mdp.action_names.index("left")]
    assert np.array_equal(left[going], ((col > 1) | (row == 2))[going])
    up = mdp.choice_action == mdp.action_names.index("up")
    halves = np.bincount(mdp.branch_choice, minlength=len(up)) == 2
    centre = (row[mdp.choice_state] == 1) & (col[mdp.choice_state] == 1)
    assert np.array_equal(halves & up, centre & up)
    assert np.any(centre & up)


def test_a_declared_name_wins(tmp_path: Path) -> None:
    text = replaced(
        graph('{value: "row + (at > 2 ? 1 : 0)"}'), "    light: {", "    row: {range: [5, 5], default: 5}\n"
        "    at: {range: [0, 3], default: 3}\n    light: {",
    )  # fmt: skip
    mdp = explored(tmp_path, text, "open.slow.g")
    assert set(mdp.choice_reward.tolist()) == {0.0, 6.0}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (graph("{where: at(H), value: 1}"), "where: unknown location 'H' at column 4; known: goal, blocked"),
        (graph("{where: at(light), value: 1}"), "unknown location 'light' at column 4"),
        (graph("{where: at(bonus), value: 1}"), "'bonus' is of type real, it holds no locations"),
        (graph('{where: "at([0, 1])", value: 1}'), r"unknown location \[0, 1\]: .* belongs to a grid"),
        (graph("{value: row}"), "value: 'row' at column 1: rows and columns belong to a grid"),
        (graph("{value: goal}"), r"'goal' at column 1 can't be read here: it is of type locations"),
        (graph("{value: goal + 1}"), "'goal' at column 1 can't be read here"),
        (graph("{value: at(A)}"), r"'at\(A\)' is a bool, expected a number"),
        (
            replaced(GRAPH, "  unsafe: light = 0 & mode != scanning", '  unsafe: "at\'(A)"'),
            r"unsafe: \"?at'\(A\)\"?.* can't be read here: where a step leads is not known",
        ),
        (
            replaced(GRAPH, "east: {move: east, probability: \"slippery' ? grip * 0.5 : grip\"}",
                     "east: {move: east, probability: \"moved ? grip : 1\"}"),
            "'moved' at column 1 can't be read here: where a step leads is not known",
        ),
        (CELLS.replace("VALUE", "at([3, 0]) ? 1 : 0"), "rows are 0 to 2, columns 0 to 2"),
        (CELLS.replace("VALUE", "at([1.5, 0]) ? 1 : 0"), "a cell .* of whole numbers"),
    ],
)  # fmt: skip
def test_what_is_no_location_is_one_line_with_its_place(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        load_declared_case(write_case(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert "case.yaml:" in str(caught.value)
