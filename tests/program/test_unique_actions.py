"""Every choice of commands as an action of its own, by hand and against random programs as they were."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import HealthCheck, assume, given, settings

from merap.errors import InputError, ModelError
from merap.program.exploration import explore
from merap.program.expressions import parse
from merap.program.form import Process, Program, RewardItem, RewardStructure, integer
from merap.program.unique_actions import ambiguous_actions, unique_actions
from tests.support.explored import choices_of
from tests.support.programs import command, outcome, programs, start


def process(name: str, variable: str, *guards: tuple[str | None, str]) -> Process:
    commands = (command(action, guard, [outcome("1", **{variable: "0"})]) for action, guard in guards)
    return Process(name, "environment", (integer(variable, 0, 4),), tuple(commands), start(**{variable: "0"}))


@pytest.mark.parametrize(("guard", "expected"), [("x > 3", {}), ("x > 2", {"go": 3}), ("x >= 0", {"go": 0})])
def test_an_action_is_ambiguous_where_two_of_its_commands_are_enabled(
    guard: str, expected: dict[str, int]
) -> None:
    commands = (
        command("go", "x <= 3", [outcome("1", x="mod(x + 1, 5)")]),
        command("go", guard, [outcome("1", x="0")]),
        command(None, "true", [outcome("1")]),
        command(None, "true", [outcome("1", x="0")]),
    )
    own = Process("p", "environment", (integer("x", 0, 4),), commands, start(x="0"))
    assert ambiguous_actions(explore(Program("two", (own,)))) == expected


def test_names_are_positions_among_commands_of_that_action() -> None:
    one = process("one", "x", (None, "x > 0"), ("go", "x > 0"), ("rest", "true"), ("go", "x < 3"))
    other = process("other", "y", ("go", "y = 0"), (None, "true"), ("go", "y > 0"), (None, "y > 2"))
    rules = tuple(
        RewardItem(parse("1"), actions=frozenset(actions)) for actions in ({"go"}, {None}, {"rest"}, ())
    )
    split = unique_actions(Program("two", (one, other), rewards={"r": RewardStructure(rules)}), {"go"})
    assert [[one.action for one in process.commands] for process in split.processes] == [
        ["one#1", "go#1.1", "go#1.2", "rest", "go#2.1", "go#2.2"],
        ["go#1.1", "go#2.1", "other#1", "go#1.2", "go#2.2", "other#2"],
    ]
    assert [set(rule.actions) for rule in split.rewards["r"].rules] == [
        {"go#1.1", "go#1.2", "go#2.1", "go#2.2"},
        {"one#1", "other#1", "other#2"},
        {"rest"},
        set(),
    ]


def test_too_many_combinations_are_refused() -> None:
    guards = [("go", "true")] * 20
    several = tuple(process(name, f"x_{name}", *guards) for name in "abc")
    with pytest.raises(InputError, match=r"^many: the action go has 8000 combinations of commands, at most"):
        unique_actions(Program("many", several), {"go"})


@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)
@given(programs())
def test_random_programs_keep_their_choices(program: Program) -> None:
    try:
        found = explore(program)
    except (InputError, ModelError):
        assume(False)
    split = unique_actions(program, ambiguous_actions(found))
    again = explore(split)
    assert not ambiguous_actions(again)
    before, after = choices_of(program, found), choices_of(split, again)
    assert before.keys() == after.keys()
    for state, choices in before.items():
        unnamed: Counter[object] = Counter()
        for (name, successors), count in after[state].items():
            assert name is not None
            assert count == 1
            unnamed[
                name.partition("#")[0] if name.partition("#")[0] in program.actions else None, successors
            ] += 1
        assert unnamed == choices
