"""What an objective can say: goals and labels over the whole state, starts and horizons by configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from ruamel.yaml import YAML

from merap.checker.obstruction import goal_locations
from merap.checker.properties import properties
from merap.concerns.case_study import load_declared_case
from merap.concerns.combination import DeclaredCombination
from merap.concerns.schema_program import case_schema
from merap.errors import InputError
from merap.mdp.model import TabularMDP
from merap.program.arrays import tabular
from merap.program.exploration import explore
from tests.support.case_examples import replaced, write_case
from tests.support.objective_cases import COURIER, PUMP


def built(combination: DeclaredCombination) -> TabularMDP:
    return tabular(combination.program, explore(combination.program), reward="objective")


def rows(mdp: TabularMDP, label: str) -> set[tuple[int, ...]]:
    """(row, col, bag) where a label holds."""
    columns = [mdp.variable_names.index(name) for name in ("row", "col", "bag")]
    return {tuple(row) for row in mdp.valuations[mdp.labels[label]][:, columns].tolist()}


def test_no_location_is_none(tmp_path: Path) -> None:
    unsafe = """unsafe: 'at([[0, 1], [1, 1]]) & !"loaded" & rain = wet'"""
    text = replaced(COURIER, unsafe, "unsafe: {at: []}")
    mdp = built(load_declared_case(write_case(tmp_path, text)).combination("near.default.patient"))
    assert not mdp.labels["unsafe"].any()


def test_labels_are_conditions_that_others_read(tmp_path: Path) -> None:
    mdp = built(load_declared_case(write_case(tmp_path, COURIER)).combination("near.default.patient"))
    states = {tuple(row) for row in mdp.valuations[:, :3].tolist()}
    assert mdp.variable_names[:3] == ("row", "col", "bag") or mdp.variable_names[:2] == ("row", "col")
    assert rows(mdp, "back") == {(0, 0, 0), (0, 0, 1)}
    assert rows(mdp, "over") == rows(mdp, "goal") == {(0, 0, 1)}
    assert {bag for _, _, bag in rows(mdp, "loaded")} == {1}
    assert not mdp.labels["unsafe"].any()  # it is dry
    assert len(states) > 6


def test_starts_and_horizons_differ_by_configuration(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, COURIER))
    found = {
        name: (case.system(name).objective.horizon, int(np.argmax(case.system(name).objective.start)))
        for name in ("near.default.patient", "near.default.hasty", "met")
    }
    assert found == {"near.default.patient": (9, 0), "near.default.hasty": (4, 2), "met": (5, 3)}


def test_a_goal_over_variables_is_at_no_location(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, COURIER))
    assert not goal_locations(case.combination_at(0)).any()
    text = replaced(COURIER, "goal: '\"over\"'", "goal: 'at(home) | row = 1 & col > 1'")
    other = load_declared_case(write_case(tmp_path, text)).combination("near.default.patient")
    assert np.flatnonzero(goal_locations(other)).tolist() == [0, 5]


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("", "", ["reach", "reach_within_horizon", "reward"]),
        ("  goal: '\"over\"'\n  ends_in: '\"goal\"'\n", "", ["reward"]),
        (
            "  goal: '\"over\"'\n  ends_in: '\"goal\"'\n",
            "  ends_in: at(home)\n",
            ["complete", "complete_within_horizon", "reward"],
        ),
        (
            "  goal: '\"over\"'\n  ends_in: '\"goal\"'\n",
            "  ends_after: {at: home, action: rest}\n",
            ["complete", "complete_within_horizon", "reward"],
        ),
        ("  goal: '\"over\"'\n  ends_in: '\"goal\"'\n", "  goal: 'false'\n", ["reward"]),
    ],
)
def test_properties_follow_from_what_is_there(tmp_path: Path, old: str, new: str, names: list[str]) -> None:
    text = COURIER.replace(old, new) if old else COURIER
    combination = load_declared_case(write_case(tmp_path, text)).combination("near.default.patient")
    assert list(properties(combination)) == names
    assert combination.discount == 1  # if the file gives none


def test_the_parameter_goal_is_the_goal_unless_one_is_declared(tmp_path: Path) -> None:
    text = COURIER.replace("home", "goal").replace("  goal: '\"over\"'\n", "")
    text = replaced(text, "ends_in: '\"goal\"'", "ends_in: '\"over\"'")
    case = load_declared_case(write_case(tmp_path, text))
    mdp = built(case.combination("near.default.patient"))
    np.testing.assert_array_equal(mdp.labels["goal"], mdp.labels["back"])


def test_what_may_be_left_out(tmp_path: Path) -> None:
    text = """\
case: lonely
capability: {actions: {wait: {}, work: {}}}
objective: {horizon: 2, rewards: [{action: work, value: 1}]}
"""
    case = load_declared_case(write_case(tmp_path, text))
    assert [one.name for one in case.combinations()] == ["default.default.default"]
    mdp = built(case.combination_at(0))
    assert (mdp.num_states, sorted(mdp.choice_reward.tolist())) == (1, [0, 1])


@pytest.mark.parametrize("text", [COURIER, PUMP])
def test_the_json_schema_accepts_what_loads(text: str) -> None:
    content: Any = YAML(typ="safe", pure=True).load(text)
    assert [
        error.message for error in jsonschema.Draft202012Validator(case_schema()).iter_errors(content)
    ] == []


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ("back: at(home)", "back: '\"over\"'", "labels", 'the label "back" is defined by itself'),
        ("goal: '\"over\"'", "goal: '\"ovr\"'", "goal", 'unknown label "ovr" at column 1; did you mean'),
        ("loaded: bag = full", "done: bag = full", "labels.done", "illegal name 'done' of a label"),
        (
            "back: at(home)",
            "back: at(hom)",
            "labels.back",
            "unknown location 'hom' at column 4; did you mean 'home'",
        ),
        (
            "at(shop) & rain",
            "at(home) & rain",
            "down",
            "environment and capability read nothing of the objective",
        ),
        ("back: at(home)", "back: price", "labels.back", "is a number, expected a bool"),
        (
            "back: at(home)",
            "back: at(moments)",
            "labels.back",
            "is of type int, it holds no locations",
        ),
        ("horizon: moments", "horizon: moment", "horizon", "got 'moment'; did you mean 'moments'?"),
        ("horizon: moments", "horizon: price", "horizon", "expected a number, or a parameter of type int"),
        ("moments: {int: [3, 9]}", "moments: {int: [0, 9]}", "", ""),
        ("start: from_where", "start: price", "start", "'price' is of type real, it holds no locations"),
        (
            "{at: home, bag: full}",
            "{at: home, bags: full}",
            "to.bags",
            "unknown variable 'bags'; did you",
        ),
        ("{at: home, bag: full}", "{at: home, bag: filled}", "to.bag", "unknown variable 'filled'"),
        ("{at: home, bag: full}", "{at: hom, bag: full}", "to", "unknown location 'hom'"),
        ("{at: home, bag: full}", "{at: home, bag: [full]}", "to.bag", "expected a value or an expression"),
        (
            "{at: home, bag: full}",
            "{bag: full, rows: [0, 1]}",
            "to.rows",
            "expected a value or an expression",
        ),
        ("set: full}", "set: [{value: full, probability: 0.5}, {otherwise: empty}]}", "set", "it can't draw"),
        ("rain = wet ? 0.5", "price > 1 ? 0.5", "right", "environment and capability read nothing of the"),
        (
            'requires: "!(at(shop) & rain = wet)"',
            "requires: false",
            "down",
            "nobody has the action down: no",
        ),
        ("initial: empty", "initial: 2", "bag", "the initial value of bag is 2, allowed is 0..1"),
        ("from_where: [0, 0]", "from_where: [0, 3]", "from_where", "unknown location [0, 3]"),
        ("  configurations:\n    patient", "  configuration:\n    patient", "objective", "unknown key"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, old: str, new: str, place: str, message: str) -> None:
    path = write_case(tmp_path, replaced(COURIER, old, new))
    if not message:
        load_declared_case(path)
        return
    with pytest.raises(InputError) as caught:
        load_declared_case(path)
    assert message in caught.value.message
    assert place in (caught.value.key or "")
    assert caught.value.line is not None
    assert "\n" not in str(caught.value)


def test_a_horizon_below_one_step(tmp_path: Path) -> None:
    text = replaced(replaced(COURIER, "moments: {int: [3, 9]}", "moments: int"), "moments: 4", "moments: 0")
    with pytest.raises(InputError, match=r"configurations\.hasty\.moments: the horizon is 0, allowed is"):
        load_declared_case(write_case(tmp_path, text))


def test_parameters_need_configurations(tmp_path: Path) -> None:
    text = COURIER[: COURIER.index("  configurations:\n    patient")]
    with pytest.raises(InputError, match="objective: key 'configurations' is missing: which values"):
        load_declared_case(write_case(tmp_path, text))
