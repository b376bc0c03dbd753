"""Doors: what leads through them, who opens and closes them, and which are locked."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from merap.families.models import explored
from tests.support.case_examples import replaced, write_case
from tests.support.declared_models import successors

# Two rooms with a door between them, and a way around through the yard.
ROOMS = """\
case: rooms
discount: 1
space:
  locations: {hall: [0, 0], ward: [1, 0], yard: [0, 1]}
  edges:
    - [hall, ward, east]
    - [ward, hall, west]
    - [hall, yard, north]
    - [yard, ward, east]
  attributes:
    wet: {type: bool, values: {ward: true}}
  doors:
    door:
      between: [hall, ward]
      open: false
environment:
  parameters: {locked: doors}
  configurations:
    free: {locked: []}
    shut: {locked: [door]}
capability:
  parameters: {}
  actions:
    east: {move: east, probability: "wet' ? 0.75 : 1"}
    west: {move: west, on_blocked: disable}
    north: {move: north}
    push: {requires: "at(hall)", sets: {door: true}}
    pull: {requires: "at(ward)", sets: {door: {where: door, set: false}}}
  configurations: {robot: {}}
objective:
  parameters: {}
  start: hall
  horizon: 5
  configurations: {o: {}}
"""
STATE = ("door", "loc")
CLOSED, OPEN = 0, 1
HALL, WARD, YARD = range(3)


def test_no_move_leads_through_a_closed_door(tmp_path: Path) -> None:
    found = successors(tmp_path, ROOMS, "free.robot.o", STATE)
    # a blocked move reads the place that it stays at: the hall is dry
    assert found[CLOSED, HALL]["east"] == {(CLOSED, HALL): 1}
    assert found[OPEN, HALL]["east"] == {(OPEN, WARD): 0.75, (OPEN, HALL): 0.25}
    # the same label elsewhere has no door
    assert found[CLOSED, YARD]["east"] == {(CLOSED, WARD): 0.75, (CLOSED, YARD): 0.25}


def test_a_door_is_closed_in_both_directions(tmp_path: Path) -> None:
    found = successors(tmp_path, ROOMS, "free.robot.o", STATE)
    assert found[OPEN, WARD]["west"] == {(OPEN, HALL): 1}
    # where the action is blocked it is disabled
    assert "west" not in found[CLOSED, WARD]


def test_actions_set_doors(tmp_path: Path) -> None:
    found = successors(tmp_path, ROOMS, "free.robot.o", STATE)
    assert found[CLOSED, HALL]["push"] == {(OPEN, HALL): 1}
    assert found[OPEN, WARD]["pull"] == {(CLOSED, WARD): 1}
    assert found[CLOSED, WARD]["pull"] == {(CLOSED, WARD): 1}


def test_a_locked_door_keeps_its_value_and_lets_nobody_through(tmp_path: Path) -> None:
    for shown, value in (("false", CLOSED), ("true", OPEN)):
        text = replaced(ROOMS, "open: false", f"open: {shown}\n      changes: [{{set: '!door'}}]")
        found = successors(tmp_path, text, "shut.robot.o", STATE)
        assert {state[0] for state in found} == {value}
        assert found[value, HALL]["east"] == {(value, HALL): 1}
        assert "west" not in found[value, WARD]
        assert found[value, HALL]["push"] == {(value, HALL): 1}


def test_doors_change_by_themselves(tmp_path: Path) -> None:
    text = replaced(
        ROOMS, "open: false", "open: [{value: true, probability: 0.25}, {otherwise: false}]\n"
        "      changes: [{action: [east, push], where: \"moved | door\", "
        "set: [{value: '!door', probability: 0.5}, {otherwise: door}]}]",
    )  # fmt: skip
    found = successors(tmp_path, text, "free.robot.o", STATE)
    # what the action sets comes first
    assert found[OPEN, HALL]["push"] == {(OPEN, HALL): 1}
    # the door swings with a move through it, and while it is open
    assert found[OPEN, HALL]["east"] == {
        (OPEN, WARD): 0.375, (CLOSED, WARD): 0.375, (OPEN, HALL): 0.125, (CLOSED, HALL): 0.125,
    }  # fmt: skip
    assert found[CLOSED, HALL]["east"] == {(CLOSED, HALL): 1}
    assert found[CLOSED, YARD]["east"] == {
        (CLOSED, WARD): 0.375, (OPEN, WARD): 0.375, (CLOSED, YARD): 0.25,
    }  # fmt: skip
    mdp = explored(load_declared_case(write_case(tmp_path, text)).combination("free.robot.o"))
    assert sorted(mdp.initial[mdp.initial > 0].tolist()) == [0.25, 0.75]


def test_what_is_open_is_seen_and_what_is_locked_is_not(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, ROOMS))
    names = [[one.name for one in member.program.variables] for member in case.combinations()]
    assert names == [["loc", "door", "done"]] * 2


def test_a_locked_door_cuts_a_goal_off(tmp_path: Path) -> None:
    text = replaced(
        ROOMS, "configurations:\n    free: {locked: []}\n    shut: {locked: [door]}\n",
        "configurations:\n    generate: {locked: {choose: 1, distinct: false, from: [door, gate]}}\n"
        "    require_reachable: true\n",
    )  # fmt: skip
    text = replaced(text, "      open: false\n", "      open: false\n    gate: {between: [yard, ward]}\n")
    text = replaced(
        text, "    - [hall, yard, north]\n    - [yard, ward, east]\n", "    - [yard, ward, east]\n"
    )
    text = replaced(text, "    north: {move: north}\n", "")
    text = text.replace("  parameters: {}\n  start", "  parameters: {goal: location}\n  start")
    text = replaced(text, "configurations: {o: {}}", "configurations: {o: {goal: ward}}")
    case = load_declared_case(write_case(tmp_path, text))
    assert list(case.supports.environment.names()) == ["locked_gate"]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("between: [hall, ward]", "between: [hall, wards]",
         "space.doors.door.between: unknown location 'wards'; did you mean 'ward'"),
        ("between: [hall, ward]", "between: hall", "expected the two locations that the door is between"),
        ("between: [hall, ward]", "between: [hall, hall]", "no edge connects hall and hall"),
        ("      between: [hall, ward]\n", "", "key 'between' is missing"),
        ("open: false", "open: 3", "space.doors.door.open: '3' is a number, expected a bool"),
        ("open: false", "open: door", "'door' at column 1 can't be read here: parameters alone can be"),
        ("locked: [door]", "locked: [doors]", "unknown door 'doors'; did you mean 'door'?"),
        ("locked: [door]", "locked: door", "expected a list of doors, got 'door'"),
        ("parameters: {locked: doors}", "parameters: {locked: locations}",
         "the parameter 'locked' is of type doors, not locations"),
        ("sets: {door: true}", "sets: {door: 1}", "push.sets.door: '1' is a number, expected a bool"),
        ("    door:\n", "    wet:\n", "duplicate name 'wet': it is an attribute and a variable"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line_with_its_place(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        load_declared_case(write_case(tmp_path, replaced(ROOMS, old, new)))
    assert "\n" not in str(caught.value)
    assert complaint in str(caught.value)
