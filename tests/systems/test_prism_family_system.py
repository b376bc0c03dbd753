"""A simulated member of a family that is PRISM text: its variables, slip, monitors, what lasts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.storm import build_text
from merap.concerns.combination import Combination
from merap.errors import InputError
from merap.families.loading import load_case
from merap.mdp.comparison import compare
from merap.prism.program_text import render_program
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.systems.description import ShownVariable, interface_of
from merap.systems.simulated import SimulatedSystem
from merap.systems.slip import slipping
from tests.support.small_families import RAIL, RAIL_CASE

PUSH = "push"


@pytest.fixture
def rail(tmp_path: Path) -> Combination:
    (tmp_path / "rail.prism").write_text(RAIL, encoding="utf-8")
    (tmp_path / "case.yaml").write_text(RAIL_CASE, encoding="utf-8")
    return load_case(tmp_path).combination("long.firm.default")


def simulated(rail: Combination, **settings: object) -> SimulatedSystem:
    return SimulatedSystem(rail, 30, np.random.default_rng(0), **settings)  # type: ignore[arg-type]


def pushed(system: SimulatedSystem) -> None:
    found = system.reset()
    while not found.last:
        found = system.step(system.actions.index(PUSH))
    assert found.continuation == 0


def test_a_variable_of_the_text_is_shown_whatever_it_is_called(rail: Combination) -> None:
    assert interface_of(rail, detect=True).variables == (
        ShownVariable("place", 0, 4),
        ShownVariable("pushes", 0, 3),
        ShownVariable("done", 0, 1, boolean=True),
    )


def test_slip_spares_the_module_of_the_objective(rail: Combination) -> None:
    """A push that slips is counted all the same; Storm builds the same from the text of the program."""
    program = slipping(rail.program, 0.25)
    whole = tabular(program, explore(program), reward="objective")
    compare(build_text(render_program(program, ()), program.name).mdp(), whole).require_same()
    columns = [whole.variable_names.index(name) for name in ("place", "pushes")]
    found = {}
    first = int(np.flatnonzero(whole.initial)[0])
    push = whole.choice_table[first, whole.action_names.index(PUSH)]
    for branch in np.flatnonzero(whole.branch_choice == push):
        row = whole.valuations[whole.branch_target[branch], columns]
        found[tuple(row.tolist())] = whole.branch_prob[branch]
    assert found == {(1, 1): pytest.approx(0.75 * 0.9), (0, 1): pytest.approx(0.25 + 0.75 * 0.1)}


def test_another_task_where_it_is_complete_cannot_begin(rail: Combination) -> None:
    system = simulated(rail, reset="none")
    pushed(system)
    with pytest.raises(InputError, match=r"no task can begin in state \(place=4, .*, where the last"):
        system.reset()


def test_there_is_no_start_to_return_to(rail: Combination) -> None:
    with pytest.raises(InputError, match="has no space in which to return to a start"):
        simulated(rail, reset="return_to_start")


def test_a_range_that_a_parameter_sets_limits_changes(rail: Combination, tmp_path: Path) -> None:
    """At 3 of 4 it can't go on in a rail that ends at 2; at 1 it can."""
    short = load_case(tmp_path).combination("short.firm.default")
    system = simulated(rail)
    system.reset()
    for place, fits in ((1, True), (2, False), (3, False)):
        while system.values is not None and system.values["place"] < place:
            system.step(system.actions.index(PUSH))
        assert system.fits(short) == fits
