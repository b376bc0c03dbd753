"""Evidence about parameters against the models of all hypotheses, enumerated one by one in fractions."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from merap.errors import InputError
from merap.program.evidence import Evidence, joint
from merap.program.expressions import Value, parse
from merap.program.form import (
    InitialValues,
    Process,
    Program,
    RewardItem,
    RewardStructure,
    StateVariable,
    boolean,
    integer,
)
from merap.program.hypotheses import Hypotheses
from merap.program.unique_actions import unique_actions
from tests.support.evidence_checks import NOISES, Axes, check
from tests.support.programs import OPEN, command, outcome, programs, start

AXES: Axes = [
    {"u": [Fraction(1), Fraction(0), Fraction(1, 10), Fraction(3)], "t": [True, False, True, False]},
    {"k": [Fraction(2), Fraction(1, 3)]},
]


@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)
@given(programs(OPEN))
def test_random_programs_with_parameters(program: Program) -> None:
    check(unique_actions(program), AXES, most=6)


def test_lamps() -> None:
    """One of four lamps works; the switch sticks: who wins is told by where a switch did something."""
    lamps = Process(
        "lamps",
        "environment",
        (integer("place", 0, 3), boolean("lit")),
        (
            command("left", "!lit", [outcome("1", place="max(place - 1, 0)")]),
            command("right", "!lit", [outcome("1", place="min(place + 1, 3)")]),
            command("switch", "!lit", [outcome("1 - stick", lit="place = prize"), outcome("stick")]),
        ),
        start(place="0", lit="false"),
    )
    steps = RewardStructure((RewardItem(parse("-pay"), parse("!lit")),))
    program = Program("lamps", (lamps,), {"goal": parse("lit")}, {"steps": steps})
    prizes, sticks = [Fraction(place) for place in range(4)], [Fraction(0), Fraction(1, 10), Fraction(1)]
    joint_axis: Axes = [
        {"prize": [prize for prize in prizes for _ in sticks], "stick": sticks * len(prizes)},
        {"pay": [Fraction(1), Fraction(5, 2)]},
    ]
    check(program, joint_axis)
    apart: Axes = [{"prize": prizes}, {"stick": sticks}, joint_axis[1]]
    check(program, apart)
    evidence = Evidence(program, Hypotheses(apart))
    (found,) = evidence.step(np.array([2, 0]), "switch", np.array([2, 1]))
    assert found.shape == (4, 3, 1)
    with np.errstate(divide="ignore"):
        expected = np.log([1, 0.9, 0])  # by hand: the lamp at 2 is the one, and the switch did not stick
    assert found[2, :, 0] == pytest.approx(expected)
    assert np.all(found[[0, 1, 3]] == -np.inf)
    assert evidence.reward("steps", np.array([2, 0]), "left", np.array([1, 0]), -1.0, NOISES).shape == (
        1,
        1,
        2,
        2,
    )


def test_factors_have_only_the_axes_of_what_they_read() -> None:
    """Slip is the environment's, the battery's drain the capability's: the joint table is never made."""
    walk = Process(
        "walk",
        "environment",
        (integer("x", 0, 9),),
        (command("go", "x < 9", [outcome("1 - slip", x="x + 1"), outcome("slip")]),),
        start(x="0"),
    )
    battery = Process(
        "battery",
        "capability",
        (integer("power", 0, 5),),
        (
            command("go", "power > need", [outcome("drain", power="power - 1"), outcome("1 - drain")]),
            command("load", "true", [outcome("1", power="5")]),
        ),
        start(power="5"),
    )
    program = Program("two", (walk, battery))
    axes: Axes = [
        {"slip": [Fraction(place, 100) for place in range(1, 100)]},
        {
            "drain": [Fraction(1, 2), Fraction(1, 4), Fraction(1)],
            "need": [Fraction(0), Fraction(4), Fraction(1)],
        },
    ]
    check(program, axes)
    evidence = Evidence(program, Hypotheses(axes))
    state = np.array([3, 4])
    found = evidence.step(state, "go", np.array([4, 3]))
    assert {part.shape for part in found} == {(99, 1), (1, 3)}
    assert {part.shape for part in evidence.enabled(state, ["load"])} <= {(), (1, 3)}
    assert joint(evidence.enabled(state, ["load"]), (99, 3))[0].tolist() == [-np.inf, 0, -np.inf]


def test_starts_and_ranges_may_read_parameters() -> None:
    high = StateVariable("x", parse("0"), parse("top"))
    starts = (
        InitialValues(parse("odds"), {"x": parse("1")}),
        InitialValues(parse("1 - odds"), {"x": parse("top")}),
    )
    process = Process(
        "p", "environment", (high,), (command("go", "true", [outcome("1", x="min(x + 1, 2)")]),), starts
    )
    axes: Axes = [{"top": [Fraction(2), Fraction(3), Fraction(1)]}, {"odds": [Fraction(0), Fraction(1, 3)]}]
    check(Program("starts", (process,)), axes)
    evidence = Evidence(Program("starts", (process,)), Hypotheses(axes))
    assert joint(evidence.presence(np.array([3])), (3, 2))[:, 0].tolist() == [-np.inf, 0, -np.inf]
    # under top = 1 the step leaves the range
    assert joint(evidence.step(np.array([1]), "go", np.array([2])), (3, 2))[:, 0].tolist() == [0, 0, -np.inf]


def test_starts_by_a_condition_are_equally_likely() -> None:
    variables = (integer("x", 0, 9), boolean("b"))
    commands = (command("go", "true", [outcome("1")]),)
    program = Program(
        "several",
        (Process("p", "environment", variables, commands, ()),),
        initial_predicate=parse("x < most & (b | x != k)"),
    )
    axes: Axes = [{"most": [Fraction(3), Fraction(10), Fraction(0)]}, {"k": [Fraction(1), Fraction(20)]}]
    evidence = Evidence(program, Hypotheses(axes))
    # of 2 * most states one is left out where k < most
    expected = np.array([[-np.inf, -np.log(6)], [-np.inf, -np.log(20)], [-np.inf, -np.inf]])
    assert joint(evidence.start(np.array([1, 0])), (3, 2)) == pytest.approx(expected)
    expected = np.array([[-np.log(5), -np.log(6)], [-np.log(19), -np.log(20)], [-np.inf, -np.inf]])
    assert joint(evidence.start(np.array([2, 1])), (3, 2)) == pytest.approx(expected)


def one_command(probability: str, guard: str = "true", value: str = "x + 1") -> Program:
    commands = (command("go", guard, [outcome(probability, x=value), outcome(f"1 - ({probability})")]),)
    return Program("one", (Process("p", "environment", (integer("x", 0, 3),), commands, start(x="0")),))


@pytest.mark.parametrize(
    ("program", "values", "expected"),
    [
        # decided in fractions: 0.1 * 3 <= 0.3, and 1 - 0.9 - 0.1 is nothing at all
        (one_command("1", "0.1 * k <= 0.3"), [Fraction(3), Fraction(4)], [1, 0]),
        (one_command("0.9 + 0.1 * k"), [Fraction(1), Fraction(0)], [1, 0.9]),
        (one_command("1 - 0.9 - 0.1 * k"), [Fraction(1), Fraction(0)], [0, 0.1]),
        # such hypotheses have no model: an undefined guard, probability or value; no probability
        (one_command("1", "1 / k > 0"), [Fraction(0), Fraction(1)], [0, 1]),
        (one_command("1 / k"), [Fraction(0), Fraction(2), Fraction(1, 2), Fraction(-2)], [0, 0.5, 0, 0]),
        (one_command("1", "true", "x + 1 / k"), [Fraction(0), Fraction(2), Fraction(1)], [0, 0, 1]),
        (one_command("1", "k > 0 & 1 / k > 0"), [Fraction(0), Fraction(1)], [0, 1]),
        (one_command("1", "true", "1 / 0 > k ? 1 : 1"), [Fraction(0)], [0]),
    ],
)
def test_decisions_are_exact_and_impossible_is_clean(
    program: Program, values: list[Value], expected: list[float]
) -> None:
    evidence = Evidence(program, Hypotheses([{"k": values}]))
    found = joint(evidence.step(np.array([0]), "go", np.array([1])), (len(values),))
    assert np.exp(found) == pytest.approx(expected)
    assert np.all(found[np.array(expected) == 0] == -np.inf)


def test_commands_that_are_enabled_together_are_told_apart_by_unique_actions() -> None:
    commands = (
        command("go", "k > 0", [outcome("1", x="1")]),
        command("go", "true", [outcome("0.5", x="1"), outcome("0.5", x="2")]),
        command(None, "x > 0", [outcome("1", x="0")]),
    )
    program = Program("two", (Process("p", "environment", (integer("x", 0, 2),), commands, start(x="0")),))
    hypotheses = Hypotheses([{"k": [Fraction(0), Fraction(1)]}])
    mixed = Evidence(unique_actions(program), hypotheses)
    named = Evidence(unique_actions(program, {"go"}), hypotheses)
    zero, one = np.array([0]), np.array([1])
    # by hand: two commands that are enabled together are equally likely
    assert np.exp(joint(mixed.step(zero, "go", one), (2,))) == pytest.approx([0.5, 0.75])
    assert np.exp(joint(named.step(zero, "go#1", one), (2,))).tolist() == [0, 1]
    assert np.exp(joint(named.step(zero, "go#2", one), (2,))) == pytest.approx([0.5, 0.5])
    assert joint(named.enabled(zero, ["go#2"]), (2,)).tolist() == [0, -np.inf]
    assert joint(named.enabled(one, ["go#1", "go#2", "p#1"]), (2,)).tolist() == [-np.inf, 0]


@pytest.mark.parametrize(
    ("axes", "complaint"),
    [
        ([{"k": [1, 2], "u": [1]}], "the parameter u has 1 values, expected 2"),
        ([{"k": [1]}, {"k": [1]}], "the parameter k stands in two axes of hypotheses"),
        ([{"k": []}], "there is no hypothesis about k"),
        ([{"k": [True, 1]}], "the parameter k is a truth value here, a number there"),
        ([{"u": [1]}], "one: the hypotheses give no value to k"),
    ],
)
def test_hypotheses_that_can_not_be_used(axes: Any, complaint: str) -> None:
    with pytest.raises(InputError, match=f"^{complaint}$"):
        Evidence(one_command("k"), Hypotheses(axes))


def test_unknown_names_are_named() -> None:
    evidence, zero = Evidence(one_command("k"), Hypotheses([{"k": [Fraction(1)]}])), np.array([0])
    with pytest.raises(InputError, match=r"^one: there is no action 'gp'; known: go$"):
        evidence.step(zero, "gp", zero)
    with pytest.raises(InputError, match=r"^one: there is no label 'goal'; there are none$"):
        evidence.label("goal", zero, True)
    with pytest.raises(InputError, match=r"^one: there is no reward structure 'r'; there are none$"):
        evidence.reward("r", zero, "go", zero, 1.0, NOISES)
    with pytest.raises(InputError, match=r"^one: there is no action 'gp'"):
        evidence.enabled(zero, ["gp"])
