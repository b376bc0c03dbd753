"""Names of the case language, of PRISM text and of users: whose is whose."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from merap.families.models import built, explored
from merap.mdp.comparison import compare
from tests.support.case_examples import GRID, replaced, write_case

# Names that our own text uses, keywords of the engines, and names that begin as ours do.
NAMED = """\
case: named
discount: 1
environment:
  parameters: {}
  processes:
    A: {range: [0, 2], initial: 0, changes: [{set: "min(A + 1, 2)"}]}
    open_door: {type: bool, initial: false, changes: [{action: max, set: true}]}
    goal: {type: bool, initial: false, changes: [{action: max, set: true}]}
    steps: {type: bool, initial: false}
    shift: {type: bool, initial: false}
    complete: {type: bool, initial: false}
  configurations: {e: {}}
capability:
  parameters: {}
  actions: {max: {requires: "A < 2 | steps | shift | !goal"}, module: {}, start_x: {}, any: {}, deadlock: {}}
  processes:
    pay_max:
      values: [F, G]
      initial: F
      changes:
        - {action: module, where: "open_door", set: G}
        - {action: any, where: "A = 2", set: G}
  configurations: {c: {}}
objective:
  parameters: {}
  horizon: 5
  rewards: [{action: max, value: "-A"}, {value: "open_door ? 1 : 2"}]
  ends_in: "pay_max = G | complete"
  configurations: {o: {}}
"""


def test_our_names_give_way_to_those_of_users(tmp_path: Path) -> None:
    combination = load_declared_case(write_case(tmp_path, NAMED)).combination("e.c.o")
    mdp = explored(combination)
    compare(built(combination), mdp).require_same()
    assert mdp.variable_names == ("A", "open_door", "goal", "steps", "shift", "complete", "pay_max", "done")
    assert mdp.action_names == ("max", "module", "start_x", "any", "deadlock", "end")


def test_an_action_called_any_is_that_action_alone(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, NAMED))
    assert case.warnings == (
        "capability.actions.any: changes with action: any happen with this action alone",
    )
    mdp = explored(case.combination("e.c.o"))
    columns = {name: mdp.valuations[:, place] for place, name in enumerate(mdp.variable_names)}
    ends = mdp.labels["done"][mdp.branch_target] & ~mdp.labels["done"][mdp.choice_state[mdp.branch_choice]]
    source = mdp.choice_state[mdp.branch_choice[ends]]
    taken = mdp.choice_action[mdp.branch_choice[ends]]
    by_any = taken == mdp.action_names.index("any")
    assert set(columns["A"][source[by_any]].tolist()) == {2}
    assert set(taken[~by_any].tolist()) == {mdp.action_names.index("module")}


@pytest.mark.parametrize(
    "name", ["any", "end", "stay", "moved", "at", "row", "col", "mode", "true", "false", "min", "pow"]
)
def test_no_variable_is_called_as_a_word(tmp_path: Path, name: str) -> None:
    with pytest.raises(
        InputError, match=f"illegal name '{name}' of a process: it is a word of the case language"
    ):
        load_declared_case(write_case(tmp_path, replaced(NAMED, "    steps: {", f"    '{name}': {{")))


@pytest.mark.parametrize("name", ["done", "loc", "space", "capability", "objective"])
def test_no_variable_is_called_as_one_of_every_model(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"illegal name '{name}' of a process: every model has one"):
        load_declared_case(write_case(tmp_path, replaced(NAMED, "    steps: {", f"    '{name}': {{")))


def test_a_declared_name_that_is_a_word_warns(tmp_path: Path) -> None:
    text = replaced(GRID, "  grid:", "  attributes: {row: {range: [0, 1], default: 0}}\n  grid:")
    text = replaced(text, "parameters: {goal: location}", "parameters: {goal: location, moved: real}")
    text = replaced(text, "generate: {goal: ", "generate: {moved: {from: [1]}, goal: ")
    text = replaced(text, "value: -0.5", 'value: "moved + row"').replace(
        "{goal: [2, 2]}", "{goal: [2, 2], moved: 1}"
    )
    why = "is a word of the case language; expressions read what is declared"
    expected = f"space.attributes.row: 'row' {why}", f"objective.parameters.moved: 'moved' {why}"
    assert load_declared_case(write_case(tmp_path, text)).warnings == expected
