"""Cases without space, without modes, and with attributes that have no range."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from tests.support.case_examples import GRAPH, replaced, write_case
from tests.support.declared_models import successors
from tests.support.process_cases import SERVICE

NOWHERE = replaced(
    replaced(SERVICE, "space:\n  locations: {here: [0, 0]}\n  edges: []\n", ""), "  start: here\n", ""
)
NAMES = ("load", "running", "booting", "seen")


def test_states_have_no_location_and_no_mode(tmp_path: Path) -> None:
    somewhere = successors(tmp_path, SERVICE, "calm.slow.thrift", (*NAMES, "loc"))
    nowhere = successors(tmp_path, NOWHERE, "calm.slow.thrift", NAMES)

    def without_location(rows: dict[tuple[int, ...], float]) -> dict[tuple[int, ...], float]:
        return {state[:-1]: chance for state, chance in rows.items()}

    assert nowhere == {
        state[:-1]: {action: without_location(row) for action, row in rows.items()}
        for state, rows in somewhere.items()
    }


NAP = """\
  innate:
    name: nap
    modes: [awake, asleep]
    actions: {sleep: {awake: {asleep: 1}}, wake: {asleep: {awake: 1}}}
    requires: "load > 2 & up > 0.2"
"""


def test_an_automaton_has_a_mode_and_may_require_something_of_the_state(tmp_path: Path) -> None:
    text = replaced(NOWHERE, "  configurations:\n    fast:", NAP + "  configurations:\n    fast:")
    found = successors(tmp_path, text, "rush.slow.thrift", ("load", "mode", "running", "booting", "seen"))
    for (load, mode, *_), rows in found.items():
        assert ("sleep" in rows) == (load > 2 and mode == 0)
        assert ("wake" in rows) == (load > 2 and mode == 1)
    # what never holds with an environment leaves the automaton out
    found = successors(tmp_path, text, "calm.slow.thrift", ("load", "mode", "running", "booting", "seen"))
    assert {action for rows in found.values() for action in rows} == {"keep", "grow", "shrink"}


def test_outcomes_that_lead_nowhere_make_no_difference(tmp_path: Path) -> None:
    text = replaced(NOWHERE, "keep: {stay: 1}", "keep: {outcomes: [{probability: 0.5}, {probability: 0.5}]}")
    assert successors(tmp_path, text, "calm.slow.thrift", NAMES) == successors(
        tmp_path, NOWHERE, "calm.slow.thrift", NAMES
    )


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("w_time: real}", "w_time: location}", "'w_time' is of type location, and the case has no space"),
        ("  horizon: 30\n", "  horizon: 30\n  start: here\n", "objective.start: this speaks of locations"),
        ("running > 1", "at(here)", "shrink.requires: 'at(here)' at column 4 speaks of locations"),
        ("running > 1", "row > 1", "'row' at column 1 speaks of locations, and the case has no space"),
        ("where: \"load' = 4\"", "where: moved", "'moved' at column 1 speaks of locations"),
        ("running > 1", "mode = 0", "unknown variable 'mode'"),
        ("    - {value: \"-w", "    - {at: here, value: \"-w", "at: 'at(here)' speaks of locations"),
        ("keep: {stay: 1}", "keep: {move: east}", "keep.move: unknown edge label 'east'; known: stay"),
        ("keep: {stay: 1}", "keep: {outcomes: [{probability: 0.5}, {probability: 0.4}]}",
         "action keep: the probabilities sum to 0.9, not 1, (environment "),
    ],
)  # fmt: skip
def test_nothing_speaks_of_locations(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        load_declared_case(write_case(tmp_path, replaced(NOWHERE, old, new)))
    assert "\n" not in str(caught.value)
    assert complaint in str(caught.value)


def test_a_space_needs_a_start(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"objective: key 'start' is missing"):
        load_declared_case(write_case(tmp_path, replaced(SERVICE, "  start: here\n", "")))


SLOPE = "    slope: {range: [0.0, 1.0], default: 0.25}\n"


def test_numbers_without_a_range(tmp_path: Path) -> None:
    text = replaced(GRAPH, SLOPE, "    slope: {type: real, default: -1e3, values: {B: 12345.5}}\n")
    text = replaced(text, "    slippery:", "    depth: {type: int, default: 7}\n    slippery:")
    attributes = {one.name: one for one in load_declared_case(write_case(tmp_path, text)).space.attributes}
    assert attributes["slope"].values.tolist() == [-1000, -1000, 12345.5, -1000]
    assert attributes["depth"].values.tolist() == [7, 7, 7, 7]


@pytest.mark.parametrize(
    ("declared", "complaint"),
    [
        ("{default: 0.25}", "give range: [least, greatest], or type: bool, int or real"),
        ("{type: int, default: 0.25}", "expected a whole number, got 0.25"),
        ("{type: real}", "key 'default' is missing: location S has no value"),
    ],
)
def test_what_an_attribute_lacks(tmp_path: Path, declared: str, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        load_declared_case(write_case(tmp_path, replaced(GRAPH, SLOPE, f"    slope: {declared}\n")))
    assert complaint in str(caught.value)


def test_a_detector_needs_a_range(tmp_path: Path) -> None:
    text = replaced(GRAPH, SLOPE, "    slope: {type: real, default: 0}\n")
    text = replaced(text, "    lidar: {of: blocked,", "    lidar: {of: slope,")
    with pytest.raises(
        InputError, match=r"attributes.slope: key 'range' is missing: the detector lidar reads"
    ):
        load_declared_case(write_case(tmp_path, text))
