"""Where a program has a step, and complete states in which it has none but `end`, by hand."""

from __future__ import annotations

import numpy as np

from merap.program.arrays import tabular
from merap.program.completion import completed, enabled
from merap.program.exploration import explore
from merap.program.expressions import Constant, all_of, any_of, evaluate, negation, parse
from merap.program.form import Process, Program, integer
from tests.support.programs import command, outcome, start


def step(action: str | None, guard: str) -> Process:
    name = guard[0]
    commands = (command(action, guard, [outcome("1", **{name: f"{name} + 1"})]),)
    return Process(name, "environment", (integer(name, 0, 3),), commands, start(**{name: "0"}))


def test_a_step_needs_a_command_of_every_process_that_knows_the_action() -> None:
    program = Program("both", (step("go", "x < 2"), step("go", "y < 3"), step(None, "z < 1")))
    x, y, z = (column.ravel() for column in np.meshgrid(range(4), range(4), range(4)))
    found = evaluate(enabled(program), {"x": x, "y": y, "z": z})
    assert np.array_equal(found, (x < 2) & (y < 3) | (z < 1))


def test_a_complete_state_has_the_action_end_alone() -> None:
    whole = completed(Program("up", (step("go", "x < 3"),)), parse("x = 2"), "last")
    mdp = tabular(whole, explore(whole))
    assert mdp.valuations.ravel().tolist() == [0, 1, 2]
    assert [mdp.action_names[action] for action in mdp.choice_action] == ["go", "go", "end"]
    assert mdp.branch_target.tolist() == [1, 2, 2]


def test_a_deadlock_can_be_completed() -> None:
    program = Program("up", (step("go", "x < 3"),))
    whole = completed(program, negation(enabled(program)), "last")
    assert tabular(whole, explore(whole)).choice_action.tolist() == [0, 0, 0, 1]


def test_no_condition_and_the_same_twice() -> None:
    assert (all_of([]), any_of([])) == (Constant(True), Constant(False))
    assert all_of([parse("x > 0"), parse("x > 0")]) == parse("x > 0")
