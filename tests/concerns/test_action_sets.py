"""What actions set: independently of the move, or together with one of its outcomes."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from tests.support.case_examples import replaced, write_case
from tests.support.declared_models import successors
from tests.support.feature_cases import FEATURES

WALK = """\
case: walk
discount: 1
space:
  locations: {a: [0, 0], b: [1, 0]}
  edges: [[a, b, go], [b, a, back]]
environment:
  parameters: {}
  processes:
    lamp:
      type: bool
      initial: false
      changes: [{set: "!lamp"}]
  configurations: {e: {}}
capability:
  parameters: {}
  actions:
    go: {move: go, probability: 0.5, sets: {lamp: {where: "at(a)", set: true}}}
    slip:
      outcomes:
        - {move: go, probability: 0.5, sets: {charge: {left: "left - 1"}, lamp: true}}
        - {probability: 0.25, sets: {charge: {where: "left = 2", set: {left: 0, worn: true}}}}
        - {move: back, probability: 0.25}
      requires: "left > 0"
    rest: {}
  processes:
    charge:
      variables: {left: {range: [0, 2], initial: 2}, worn: {type: bool, initial: false}}
      changes: [{action: rest, set: {left: 2}}]
  configurations: {c: {}}
objective:
  parameters: {}
  start: a
  horizon: 5
  configurations: {o: {}}
"""
GO = '    go: {move: go, probability: 0.5, sets: {lamp: {where: "at(a)", set: true}}}\n'
STATE = ("lamp", "loc", "left", "worn")
A, B = 0, 1


def test_an_action_sets_a_process_before_its_own_changes(tmp_path: Path) -> None:
    found = successors(tmp_path, WALK, "e.c.o", STATE)
    # at a the lamp is lit, whether the move succeeds or not
    assert found[0, A, 2, 0]["go"] == {(1, A, 2, 0): 0.5, (1, B, 2, 0): 0.5}
    # elsewhere nothing is set, and the lamp blinks
    assert found[1, B, 2, 0]["go"] == {(0, B, 2, 0): 1}
    assert found[0, A, 2, 0]["rest"] == {(1, A, 2, 0): 1}


def test_what_an_outcome_sets_is_drawn_with_its_move(tmp_path: Path) -> None:
    found = successors(tmp_path, WALK, "e.c.o", STATE)
    assert found[1, A, 2, 0]["slip"] == {
        (1, B, 1, 0): 0.5,  # the move: charge and lamp are set with it
        (0, A, 0, 1): 0.25,  # the second outcome, where charge is full; the lamp blinks
        (0, A, 2, 0): 0.25,  # the third sets nothing, and is blocked
    }
    # where the condition does not hold the owner's changes follow, here none
    assert found[1, A, 1, 0]["slip"] == {(1, B, 0, 0): 0.5, (0, A, 1, 0): 0.5}


def test_an_outcome_that_is_blocked_sets_all_the_same(tmp_path: Path) -> None:
    found = successors(tmp_path, WALK, "e.c.o", STATE)
    assert found[1, B, 2, 0]["slip"] == {(1, B, 1, 0): 0.5, (0, B, 0, 1): 0.25, (0, A, 2, 0): 0.25}


def test_outcomes_set_by_chance_and_by_where_they_lead(tmp_path: Path) -> None:
    text = replaced(WALK, "lamp: true}}", 'lamp: {where: "moved", set: [{value: true, probability: 0.25},'
                    ' {otherwise: lamp}]}}}')  # fmt: skip
    found = successors(tmp_path, text, "e.c.o", STATE)
    assert found[0, A, 1, 0]["slip"] == {(1, B, 0, 0): 0.125, (0, B, 0, 0): 0.375, (1, A, 1, 0): 0.5}
    # at b the move is blocked: nothing is set, and the lamp blinks
    assert found[0, B, 1, 0]["slip"][1, B, 0, 0] == 0.5


def test_a_process_may_read_what_an_outcome_has_set(tmp_path: Path) -> None:
    # `heat` stands between the lamp and the charge, and reads what the lamp becomes
    text = replaced(
        WALK, "  configurations: {e: {}}",
        "    heat: {range: [0, 1], initial: 0, changes: [{set: \"lamp' ? 1 : 0\"}]}\n"
        "  configurations: {e: {}}",
    )  # fmt: skip
    found = successors(tmp_path, text, "e.c.o", ("lamp", "heat", "loc", "left", "worn"))
    for rows in found.values():
        for row in rows.values():
            assert all(lamp == heat for lamp, heat, *_ in row)


def test_an_outcomes_change_comes_before_its_actions_and_that_before_the_owners(tmp_path: Path) -> None:
    found = successors(
        tmp_path, FEATURES["an outcome sets what its action and the owner change too"],
        "default.default.default", ("lamp", "loc"),
    )  # fmt: skip
    # lamp = 0: the first outcome's change matches; with the others the action's does
    assert found[0, A]["go"] == {(4, B): 0.5, (3, A): 0.5}
    # lamp = 1: the outcome's does not match any more, the action's still does
    assert found[1, A]["go"] == {(3, B): 0.5, (3, A): 0.5}
    # lamp = 3: neither matches, so that the owner's follows
    assert found[3, A]["go"] == {(4, B): 0.5, (4, A): 0.5}


def test_without_space_an_outcome_sets_too(tmp_path: Path) -> None:
    text = replaced(
        WALK, "space:\n  locations: {a: [0, 0], b: [1, 0]}\n  edges: [[a, b, go], [b, a, back]]\n", ""
    )
    text = replaced(
        text, '    go: {move: go, probability: 0.5, sets: {lamp: {where: "at(a)", set: true}}}\n', ""
    )
    text = replaced(text, "        - {move: back, probability: 0.25}\n", "        - {probability: 0.25}\n")
    text = replaced(replaced(text, "{move: go, ", "{move: stay, "), "  start: a\n", "")
    found = successors(tmp_path, text, "e.c.o", ("lamp", "left", "worn"))
    assert found[1, 2, 0]["slip"] == {(1, 1, 0): 0.5, (0, 0, 1): 0.25, (0, 2, 0): 0.25}


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("sets: {lamp: {where", "sets: {lamb: {where", "unknown process 'lamb'; did you mean 'lamp'?"),
        ("{charge: {left: \"left - 1\"}", "{left: \"left - 1\"",
         "sets.left: unknown process 'left': it is a variable of charge"),
        ("sets: {lamp: {where", "sets: {seen: {where", "the process seen belongs to the objective"),
        ("sets: {charge: {left:", "sets: {charge: {lft:", "unknown variable 'lft' of the process"),
        ("set: true}", "set: 2}", "sets.lamp.set: '2' is a number, expected a bool"),
        ("where: \"left = 2\"", "where: \"left\"", "'left' is a number, expected a bool"),
        ("where: \"left = 2\"", "where: \"seen > 0\"", "read nothing of the objective"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line_with_its_place(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    text = replaced(WALK, "  start: a\n", "  start: a\n  processes: {seen: {range: [0, 1], initial: 0}}\n")
    with pytest.raises(InputError) as caught:
        load_declared_case(write_case(tmp_path, replaced(text, old, new)))
    assert "\n" not in str(caught.value)
    assert complaint in str(caught.value)
