"""Expressions over the location and the mode as text that engines decide and compute right."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from merap.concerns.combination import Condition, DeclaredCombination, RewardRule
from merap.concerns.composition import compose
from merap.concerns.external_action import ExternalAction, Outcome
from merap.concerns.innate import InnateAction
from merap.concerns.location_tables import LocationTables
from merap.concerns.space import Attribute
from merap.errors import InputError
from merap.prism.engine_text import EngineText, text_of
from merap.prism.lines import Formula
from merap.prism.program_text import render_program
from merap.program.expressions import Constant, parse
from merap.program.form import Program
from tests.support.hand_made import (
    at,
    graph_combination,
    number,
    parsed,
    with_capability,
    with_environment,
    with_objective,
)
from tests.support.programs import process_of

EAST, WEST, ACROSS = 0, 1, 2
AT_B = np.array([False, False, True, False])
AT_G = np.array([False, False, False, True])
SCANNED = parsed("mode' = 2")


def writers(combination: DeclaredCombination) -> tuple[EngineText, LocationTables]:
    return EngineText(compose(combination)), LocationTables(combination)


def truth(text: str, combination: DeclaredCombination | None = None) -> tuple[str, list[str]]:
    """A condition, and the tables that it needs."""
    writer, tables = writers(combination or graph_combination())
    return writer.truth(tables.read(parsed(text))), [one.text for one in writer.take() if one.meaning]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.8", "4/5"),
        ("-0.5", "-1/2"),
        ("light", "light"),
        ("light'", "light_east"),
        ("mode", "mode"),
        ("light' > light ? 1 : 0", "light_east>light ? 1 : 0"),
        ("ice = light > 1 ? 1 : 0", "ice = light > 1 ? 1 : 0"),
        ("ice => light <= 2 ? 1 : 0", "ice => light<=2 ? 1 : 0"),
        ("0.12345678901", "0.12345678901"),
    ],
)
def test_numbers_of_an_outcome_read_where_the_intended_move_leads(text: str, expected: str) -> None:
    writer, tables = writers(graph_combination())
    assert text_of(writer.number_form(tables.intended(parsed(text), EAST))) == expected


def test_attributes_become_formulas_once() -> None:
    writer, tables = writers(graph_combination())
    writer.number_form(tables.intended(parsed("light' + light"), EAST))
    # light is 3, 2, 0, 2 at S, A, B, G; east leads to A, B, G and from G nowhere
    assert writer.take() == [
        Formula("light_east", "loc=1 ? 0 : 2"),
        Formula("light", "loc=0 ? 3 : loc=2 ? 0 : 2"),
    ]
    # west from G is B, S has no way west, and neither is icy: nothing to look up
    assert text_of(writer.number_form(tables.intended(parsed("ice' ? light : 0"), WEST))) == "0"
    assert writer.take() == []


def test_a_blocked_move_reads_the_own_location() -> None:
    writer, tables = writers(with_environment(graph_combination(), blocked=AT_G))
    writer.truth(tables.intended(parsed("ice'"), EAST))
    assert writer.take() == [Formula("ice_east", "loc=3")]


def test_attributes_and_labels_that_make_one_name_are_told_apart() -> None:
    graph = graph_combination()
    low, high = np.array([0.0, 0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0])
    attributes = (Attribute("ice", "bool", 0, 1, low), Attribute("ice_far", "bool", 0, 1, high))
    space = replace(graph.space, moves=("far_east", "east", "across"))
    plain = with_objective(graph, rules=(), unsafe=None)
    stop = with_capability(plain, external=(ExternalAction("stop", (Outcome(None, number(1)),), "stay"),))
    writer, tables = writers(with_environment(replace(stop, space=space), attributes=attributes))
    assert writer.truth(tables.intended(parsed("ice'"), 0)) == "ice_far_east"
    assert writer.truth(tables.intended(parsed("ice_far'"), 1)) == "ice_far_east_"
    assert writer.truth(tables.intended(parsed("ice'"), 0)) == "ice_far_east"
    assert [formula.name for formula in writer.take()] == ["ice_far_east", "ice_far_east_"]


def go(*outcomes: Outcome) -> str:
    """The updates of an action."""
    action = ExternalAction("go", outcomes, "stay")
    text = render_program(compose(with_capability(graph_combination(), external=(action,))))
    module = text.partition("module space")[2].partition("endmodule")[0].replace("\n    ", "")
    return next(line for line in module.splitlines() if line.startswith("  [go]")).partition(" -> ")[2]


def test_probabilities_of_an_external_action() -> None:
    rest = Outcome(None, parsed("1 - (ice' ? 0.6 : 1)"))
    command = go(Outcome(EAST, parsed("ice' ? 0.6 : 1")), Outcome(WEST, number(0)), rest)
    assert command == "(ice_east ? 3/5 : 1) : (loc'=loc_east) + (ice_east ? 2/5 : 0) : true;"


def test_computed_probabilities_are_tabulated() -> None:
    # light is 3, 2, 0, 2 at S, A, B, G: 0.4 + 0.2 * 3 is 1, and Storm would make a branch of -1.1e-16
    rest = Outcome(None, parsed("1 - (0.4 + 0.2 * light)"))
    command = go(Outcome(EAST, parsed("0.4 + 0.2 * light")), rest)
    assert command == (
        "(loc=0 ? 1 : loc=2 ? 2/5 : 4/5) : (loc'=loc_east) + (loc=0 ? 0 : loc=2 ? 3/5 : 1/5) : true;"
    )


def test_a_tiny_probability_is_not_dropped() -> None:
    tiny = Fraction(1, 10**15)
    command = go(Outcome(EAST, Constant(1 - tiny)), Outcome(None, Constant(tiny)))
    assert command == "0.999999999999999 : (loc'=loc_east) + 1e-15 : true;"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # light is 3, 2, 0, 2 at S, A, B, G
        ("light * 0.1 + 0.2 <= 0.5", "light + 2 <= 5"),
        ("light * 0.1 + 0.2 < 0.5", "light + 2 < 5"),
        ("ice | light / 10 = 0.3", "ice | light=3"),
        ("light > 0 & 1 / light < 0.4", "light>0 & loc=0"),
        ("light + mode * 0.1 > 2.1", "10 * light + mode > 21"),
        ("light * 2 + mode <= 5", "light * 2 + mode <= 5"),
        ("floor(light / 2) = 1", "floor(light / 2) = 1"),
        ("light > 0.3", "10 * light > 3"),
        # numbers that doubles hold, and engines take for equal, or that are too large
        ("light > 2.9999999999", "loc=0"),
        ("light * 1000000000 > 2999999999", "loc=0"),
        ("light + 9007199254740992 > 9007199254740994", "loc=0"),
        ("light + mode + 9007199254740992 > 9007199254740994",
         "mode<1 ? loc=0 : !(loc=2)"),
        ("pow(light, 2) > 4", "light * light > 4"),
        ("pow(light, 0.5) > 1.5", "loc=0"),
    ],
)  # fmt: skip
def test_engines_decide_no_comparison_of_rounded_numbers(text: str, expected: str) -> None:
    assert truth(text) == (expected, [])


def test_a_long_table_is_a_formula_that_says_what_it_means() -> None:
    line = np.arange(4.0)
    slope = Attribute("slope", "real", 0, 9, np.sqrt(line + 1))
    graph = with_objective(graph_combination(), rules=(), unsafe=None)
    stop = with_capability(graph, external=(ExternalAction("stop", (Outcome(None, number(1)),), "stay"),))
    combination = with_environment(stop, attributes=(slope,))
    writer, tables = writers(combination)
    form = writer.probability_form(tables.read(parsed("slope / 10 + (mode = 1 ? 0.5 : 0)")))
    assert text_of(form) == "value_1"
    (formula,) = writer.take()
    assert formula.meaning == "slope / 10 + (mode=1 ? 1/2 : 0)"
    assert formula.text.startswith("mode<1 ? (loc=")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-0.5 * light + 1", "((-1) * light + 2) / 2"),
        ("floor(light * 0.3 / 0.9)", "floor(light * 3 * 10 / 90)"),
        ("(light + 9007199254740993) - 9007199254740992", "loc=0 ? 4 : loc=2 ? 1 : 3"),
        ("mod(light - 3, 0.3)", "(10 * (light - 3) - 3 * floor((light - 3) * 10 / 3)) / 10"),
        ("light * 1000000", "light * 1000000"),
        ("1 / light", "loc=0 ? 1/3 : 1/2"),
    ],
)
def test_engines_compute_no_number_that_rounding_can_spoil(text: str, expected: str) -> None:
    writer, tables = writers(graph_combination())
    assert text_of(writer.number_form(tables.read(parsed(text)))) == expected


def pay(*rules: RewardRule, action: str = "go") -> str:
    return items(with_objective(graph_combination(), rules=rules))[action]


def items(combination: DeclaredCombination) -> dict[str, str]:
    """What each action pays, by `action` or `action guard`."""
    text = render_program(compose(combination)).replace("\n    ", " ").replace("  ", " ")
    formulas = dict(
        line.removeprefix("formula ").rstrip(";").split(" = ", 1)
        for line in text.splitlines()
        if line.startswith("formula pay_")
    )
    found: dict[str, str] = {}
    for line in text.partition('rewards "objective"\n')[2].partition("endrewards")[0].splitlines():
        guard, _, value = line.strip().rstrip(";").partition(" : ")
        name = guard.replace("[", "").replace("]", "").removesuffix(" true")
        found[name] = formulas.get(value, value)
    return found


def test_what_an_action_pays() -> None:
    goal = RewardRule(Condition(where=at(AT_G, "'")), number(5))
    rest = RewardRule(Condition(), number("-0.5"))
    assert items(with_objective(graph_combination(), rules=())) == {"true": "0"}
    assert pay(rest, action="jump") == "-1/2"
    assert pay(goal, rest, action="back") == "-1/2"
    # across leads from S to B, staying there is no step to G but from G itself
    assert pay(goal, rest, action="jump") == "loc=3 ? 5 : -1/2"
    assert pay(rest, goal, action="jump") == "-1/2"
    across = RewardRule(Condition(where=at(AT_B, "'")), number(5))
    assert pay(across, rest, action="jump") == "1/2 * (loc=0 | loc=2 ? 5 : -1/2) + 1/2 * (loc=2 ? 5 : -1/2)"
    assert pay(RewardRule(Condition(where=SCANNED), number(3)), action="measure") == "9/10 * 3"
    assert pay(RewardRule(Condition(where=SCANNED), number(3)), rest, action="measure") == (
        "9/10 * 3 + 1/10 * (-1/2)"
    )


def test_an_innate_action_pays_by_its_mode() -> None:
    graph = graph_combination()
    assert graph.capability.innate is not None
    rows = {0: {1: number(1)}, 1: {2: number(1)}}
    innate = replace(graph.capability.innate, actions=(InnateAction("measure", rows),))
    rules = (RewardRule(Condition(), parsed("mode' - 3 * mode")),)
    found = items(with_objective(with_capability(graph, innate=innate), rules=rules))
    assert (found["measure mode=0"], found["measure mode=1"]) == ("1 - 3 * mode", "2 - 3 * mode")


@pytest.mark.parametrize(
    ("rules", "shift"),
    [
        ((), 1),
        ((RewardRule(Condition(), number(5)),), 1),
        ((RewardRule(Condition(), number("-2.5")),), 3),
        # interval arithmetic: light is 0 to 3, so that a step may lose 6, although -across-> loses 3 at most
        ((RewardRule(Condition(), parsed("light' - 2 * light")),), 7),
    ],
)
def test_the_shift_is_above_the_greatest_loss(rules: tuple[RewardRule, ...], shift: int) -> None:
    text = render_program(compose(with_objective(graph_combination(), rules=rules)))
    assert f"const double shift = {shift};" in text


def test_no_loss_is_greater_than_the_shift() -> None:
    # light is 3, 2, 0, 2: 1 / light is undefined at B, where the rule does not apply
    above = Condition(where=parsed("light > 0"))
    combination = with_objective(graph_combination(), rules=(RewardRule(above, parsed("-7 / light")),))
    assert "const double shift = 4;" in render_program(compose(combination))


def test_a_table_over_too_many_values_is_refused() -> None:
    program = Program("wide", (process_of(x=(0, 99), y=(0, 99)),))
    with pytest.raises(InputError, match=r"x, y has 10000 cases, .*: x / \(y \+ 1\) > 1/2"):
        EngineText(program).truth(parse("x / (y + 1) > 0.5"))
