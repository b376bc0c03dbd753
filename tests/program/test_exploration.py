"""Explored programs against fractions in pure Python, a state at a time."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from merap.errors import ModelError
from merap.program.exploration import explore
from merap.program.form import Process, Program, boolean, integer
from tests.support.explored import Choices, choices_of, states_of
from tests.support.program_enumeration import BrokenError, State, enumerate_model
from tests.support.programs import ONE_COIN, command, outcome, programs, start


def expected_choices(choices: dict[State, list[tuple[str | None, dict[State, Fraction]]]]) -> Choices:
    return {
        state: Counter(
            (action, frozenset((successor, round(float(prob), 12)) for successor, prob in successors.items()))
            for action, successors in own
        )
        for state, own in choices.items()
    }


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)
@given(programs())
def test_random_programs_have_the_model_that_fractions_give(program: Program) -> None:
    try:
        initial, choices = enumerate_model(program)
    except BrokenError:
        with pytest.raises(ModelError, match="random: "):
            explore(program)
        return
    found = explore(program)
    assert choices_of(program, found) == expected_choices(choices)
    named = states_of(program, found)
    starts = {
        named[code]: chance for code, chance in zip(found.codes.tolist(), found.initial.tolist(), strict=True)
    }
    assert {state: chance for state, chance in starts.items() if chance} == pytest.approx(initial)


def chain(length: int) -> Program:
    """Narrow and deep: every frontier is one state."""
    walk = Process(
        "walk",
        "environment",
        (integer("x", 0, length),),
        (
            command("go", f"x < {length}", [outcome("0.5", x="x + 1"), outcome("0.5")]),
            command("rest", f"x = {length}", [outcome("1")]),
        ),
        start(x="0"),
    )
    return Program("chain", (walk,))


def test_the_three_ways_to_explore_agree() -> None:
    # 40,000 states in a row: the search gives up its frontiers and computes all valuations at once
    long = explore(chain(40_000))
    assert len(long.codes) == 40_001
    given_states = long.encoding.valuations(long.codes)[::-1]
    again = explore(chain(40_000), given_states)
    for name in ("source", "choice", "target", "prob"):
        assert np.array_equal(getattr(long.branches, name), getattr(again.branches, name))
    short = explore(chain(5))
    assert choices_of(chain(5), short)[(5,)] == Counter({("rest", frozenset({((5,), 1.0)})): 1})


@pytest.mark.parametrize(
    ("states", "complaint"),
    [
        ([[0], [1], [2]], r"coin: state \(x=3\) is reachable, but is not given"),
        ([[1], [2], [3]], r"coin: state \(x=0\) is initial, but is not given"),
        ([[0], [1], [2], [3], [3]], "coin: a given state is given twice"),
        ([[0], [1], [2], [3], [4]], "coin: a given state has a value out of its variable's range"),
    ],
)
def test_given_states_are_checked(states: list[list[int]], complaint: str) -> None:
    with pytest.raises(ModelError, match=complaint):
        explore(ONE_COIN, np.array(states))


@pytest.mark.parametrize(
    ("commands", "complaint"),
    [
        ([command("a", "1 / x > 0", [outcome("1")])], r"the guard of \[a\] 1 / x > 0 is undefined"),
        ([command("a", "true", [outcome("0.9")])], "the probabilities of .* sum to 0.9, not 1,"),
        ([command("a", "true", [outcome("1.5"), outcome("-0.5")])], "has a probability of 1.5"),
        ([command("a", "true", [outcome("1", x="x + 5")])], r"makes x 5, allowed is 0..3,"),
        ([command("a", "true", [outcome("1", x="0.5")])], "makes x no whole number"),
        ([command("a", "true", [outcome("1", x="1 / x")])], "makes x no whole number"),
    ],
)
def test_a_fault_in_a_reachable_state_names_command_and_state(commands: list[object], complaint: str) -> None:
    process = Process("p", "environment", (integer("x", 0, 3),), tuple(commands), start(x="0"))  # type: ignore[arg-type]
    with pytest.raises(ModelError, match=rf"^broken: .*{complaint}.* in state \(x=0\)$"):
        explore(Program("broken", (process,)))


def test_a_fault_that_cannot_be_reached_does_no_harm() -> None:
    # x = 0 is never reached, there the guard divides by 0; many states make the search try all valuations
    process = Process(
        "p",
        "environment",
        (integer("x", 0, 20_000),),
        (
            command("a", "1 / x > 0 & x < 20000", [outcome("1", x="x + 1")]),
            command("b", "x = 20000", [outcome("1")]),
        ),
        start(x="1"),
    )
    assert len(explore(Program("fine", (process,))).codes) == 20_000


def test_linked_draws_read_what_came_before() -> None:
    # y becomes what x becomes: (1, 1) or (0, 0), never (1, 0)
    process = Process(
        "p",
        "environment",
        (integer("x", 0, 1), integer("y", 0, 1)),
        (command("a", "true", [outcome("0.3", x="1"), outcome("0.7", x="0")], [outcome("1", y="x'")]),),
        start(x="0", y="0"),
    )
    program = Program("linked", (process,))
    expected = frozenset({((1, 1), 0.3), ((0, 0), 0.7)})
    assert choices_of(program, explore(program))[(0, 0)] == Counter({("a", expected): 1})


def test_linked_draws_read_truths_that_came_before() -> None:
    process = Process(
        "p",
        "environment",
        (boolean("x"), boolean("y")),
        (
            command(
                "a",
                "true",
                [outcome("0.3", x="true"), outcome("0.7", x="false")],
                [outcome("1", y="!x' & !y")],
            ),
        ),
        start(x="false", y="false"),
    )
    program = Program("linked", (process,))
    expected = frozenset({((True, False), 0.3), ((False, True), 0.7)})
    assert choices_of(program, explore(program))[(False, False)] == Counter({("a", expected): 1})
