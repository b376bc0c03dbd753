from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from merap.concerns.combination import (
    Combination,
    Condition,
    ExternalAction,
    InnateAction,
    Outcome,
    RewardRule,
)
from merap.concerns.space import Attribute
from merap.prism.lines import Formula
from merap.prism.step_text import Branch, StepWriter
from merap.program.expressions import Constant
from tests.support.hand_made import (
    graph_combination,
    number,
    parsed,
    with_capability,
    with_environment,
    with_objective,
)

EAST, WEST, ACROSS = 0, 1, 2
AT_B = np.array([False, False, True, False])
AT_G = np.array([False, False, False, True])
SCANNED = np.array([False, False, True])
NOT_SCANNING = np.array([True, False, True])


def writer(combination: Combination | None = None) -> StepWriter:
    return StepWriter(combination or graph_combination())


@pytest.mark.parametrize(
    ("text", "move", "expected"),
    [
        ("0.8", EAST, "4/5"),
        ("-0.5", EAST, "-1/2"),
        ("light", EAST, "attribute_light"),
        ("light'", EAST, "attribute_light_east"),
        ("light'", None, "attribute_light"),
        ("mode", EAST, "mode"),
        ("mode' = 2", EAST, "(mode=2)"),
        ("light' > light", EAST, "(attribute_light_east>attribute_light)"),
        ("light' > light", None, "false"),
        ("light + 1 > 2", EAST, "(attribute_light + 1 > 2)"),
        ("ice = light > 1", EAST, "(attribute_ice = attribute_light > 1)"),
        ("light = 1/2", EAST, "(attribute_light = 1/2)"),
        ("ice => light <= 2", EAST, "(attribute_ice => attribute_light<=2)"),
        ("0.12345678901", EAST, "0.12345678901"),
    ],
)
def test_expressions(text: str, move: int | None, expected: str) -> None:
    assert writer().formulas.number(parsed(text), move) == expected


def test_a_mode_that_is_known_is_put_in() -> None:
    text = parsed("mode = 1 & mode' = 2 ? light : 0")
    assert writer().formulas.number(text, None, before=1, after=2) == "attribute_light"
    assert writer().formulas.number(text, None, before=1) == "0"
    assert writer().formulas.number(text, None, before=0, after=2) == "0"


def test_attributes_become_formulas_once() -> None:
    steps = writer()
    steps.formulas.number(parsed("light' + light"), EAST)
    # light is 3, 2, 0, 2 at S, A, B, G; east leads to A, B, G and from G nowhere
    assert steps.formulas.take() == [
        Formula("attribute_light", "loc=0 ? 3 : loc=2 ? 0 : 2"),
        Formula("attribute_light_east", "loc=1 ? 0 : 2"),
    ]
    steps.formulas.number(parsed("ice' ? light : 0"), WEST)
    # west from G is B; S has no way west
    assert steps.formulas.take() == [Formula("attribute_ice_west", "false")]
    assert steps.formulas.take() == []


def test_a_blocked_move_reads_the_own_location() -> None:
    blocked = with_environment(graph_combination(), blocked=AT_G)
    steps = writer(blocked)
    steps.formulas.number(parsed("ice' ? 1 : 0"), EAST)
    assert steps.formulas.take() == [Formula("attribute_ice_east", "loc=3")]


def test_attributes_and_labels_that_make_one_name_are_told_apart() -> None:
    graph = graph_combination()
    low, high = np.zeros(4), np.array([0.0, 1.0, 1.0, 1.0])
    attributes = (Attribute("ice", "bool", 0, 1, low), Attribute("ice_far", "bool", 0, 1, high))
    space = replace(graph.space, moves=("far_east", "east", "across"))
    steps = writer(with_environment(replace(graph, space=space), attributes=attributes))
    assert steps.formulas.number(parsed("ice'"), 0) == "attribute_ice_far_east"
    assert steps.formulas.number(parsed("ice_far'"), 1) == "attribute_ice_far_east_"
    assert steps.formulas.number(parsed("ice'"), 0) == "attribute_ice_far_east"
    assert [formula.name for formula in steps.formulas.take()] == [
        "attribute_ice_far_east",
        "attribute_ice_far_east_",
    ]


def test_probabilities_of_an_external_action() -> None:
    action = ExternalAction(
        "go",
        (
            Outcome(EAST, parsed("ice' ? 0.6 : 1")),
            Outcome(WEST, number(0)),
            Outcome(None, parsed("1 - (ice' ? 0.6 : 1)")),
        ),
        "stay",
    )
    step = writer().external(action)
    assert step.branches == (
        Branch("(attribute_ice_east ? 3/5 : 1)", move=EAST),
        Branch("(attribute_ice_east ? 2/5 : 0)", move=None),
    )


def test_computed_probabilities_are_tabulated() -> None:
    # light is 3, 2, 0, 2 at S, A, B, G: 0.4 + 0.2 * 3 is 1, and Storm would make a branch of -1.1e-16
    rest = Outcome(None, parsed("1 - (0.4 + 0.2 * light)"))
    action = ExternalAction("go", (Outcome(EAST, parsed("0.4 + 0.2 * light")), rest), "stay")
    steps = writer()
    assert [branch.probability for branch in steps.external(action).branches] == [
        "attribute_value_1",
        "attribute_value_2",
    ]
    assert steps.formulas.take() == [
        Formula("attribute_value_1", "loc=0 ? 1 : loc=2 ? 2/5 : 4/5", "2/5 + 1/5 * light"),
        Formula("attribute_value_2", "loc=0 ? 0 : loc=2 ? 3/5 : 1/5", "1 - (2/5 + 1/5 * light)"),
    ]


def test_computed_probabilities_are_tabulated_in_the_modes_that_matter() -> None:
    # external actions are possible in the modes 0 and 2
    action = ExternalAction("go", (Outcome(EAST, parsed("mode * light / 6")),), "stay")
    steps = writer()
    assert steps.external(action).branches == (Branch("attribute_value_1", move=EAST),)
    (formula,) = steps.formulas.take()
    assert formula.text == "mode=0 ? 0 : (loc=0 ? 1 : loc=2 ? 0 : 2/3)"


@pytest.mark.parametrize(
    ("text", "expected", "table"),
    [
        # light is 3, 2, 0, 2 at S, A, B, G
        ("light * 0.1 + 0.2 <= 0.5", "attribute_test_1", "true"),
        ("light * 0.1 + 0.2 < 0.5", "attribute_test_1", "loc>=1"),
        ("ice | light / 10 = 0.3", "(attribute_ice | attribute_test_1)", "loc=0"),
        ("light > 0 & 1 / light < 0.4", "(attribute_light>0 & attribute_test_1)", "loc=0"),
        ("light + mode * 0.1 > 2.1", "attribute_test_1", "mode=0 | mode=1 ? loc=0 : !(loc=2)"),
        # whole numbers, and numbers that are rounded once, are compared right
        ("light * 2 + mode <= 5", "attribute_light * 2 + mode <= 5", None),
        ("floor(light / 2) = 1", "floor(attribute_light / 2) = 1", None),
        ("light > 0.3", "attribute_light > 3/10", None),
        # unless they are too near to each other, or too large
        ("light > 2.9999999999", "attribute_test_1", "loc=0"),
        ("light * 1000000000 > 2999999999", "attribute_test_1", "loc=0"),
        ("light + 9007199254740992 > 9007199254740994", "attribute_test_1", "loc=0"),
    ],
)
def test_engines_decide_no_comparison_of_rounded_numbers(text: str, expected: str, table: str | None) -> None:
    steps = writer()
    found = steps.formulas.truth(parsed(text), EAST)
    tables = [formula.text for formula in steps.formulas.take() if formula.meaning]
    if table == "true":
        assert (found, tables) == ("true", [])
    else:
        assert (found, tables) == (expected, [table] if table else [])


@pytest.mark.parametrize(
    ("text", "expected", "table"),
    [
        ("-0.5 * light + 1", "((-1/2) * attribute_light + 1)", None),
        ("floor(light * 0.3 / 0.9)", "attribute_value_1", "loc=0 ? 1 : 0"),
        ("(light + 9007199254740993) - 9007199254740992", "attribute_value_1", "loc=0 ? 4 : loc=2 ? 1 : 3"),
        ("mod(light - 3, 0.3)", "attribute_value_1", "loc=1 | loc=3 ? 1/5 : 0"),
        ("light * 1000000", "(attribute_light * 1000000)", None),
        ("light * 0.1 * 1000000", "attribute_value_1", "loc=0 ? 300000 : loc=2 ? 0 : 200000"),
        ("pow(light, 2)", "attribute_value_1", "loc=0 ? 9 : loc=2 ? 0 : 4"),
    ],
)
def test_engines_compute_no_number_that_rounding_can_spoil(
    text: str, expected: str, table: str | None
) -> None:
    steps = writer()
    assert steps.formulas.number(parsed(text), EAST) == expected
    assert [formula.text for formula in steps.formulas.take() if formula.meaning] == (
        [table] if table else []
    )


def test_innate_steps_one_for_each_mode() -> None:
    rows = {1: {2: Fraction(2, 3), 1: Fraction(1, 3), 0: Fraction(0)}, 0: {1: Fraction(1)}}
    assert [(step.mode, step.branches) for step in writer().innate(InnateAction("measure", rows))] == [
        (1, (Branch("2/3", mode=2), Branch("1/3", mode=1))),
        (0, (Branch("1", mode=1),)),
    ]


@pytest.mark.parametrize(
    ("condition", "branch", "mode", "expected"),
    [
        (Condition(), Branch("1"), None, "true"),
        (Condition(actions=frozenset({"stop"})), Branch("1"), None, "false"),
        (Condition(actions=frozenset({"go"})), Branch("1"), None, "true"),
        (Condition(at=AT_G), Branch("1"), None, "loc=3"),
        (Condition(to=AT_G), Branch("1", move=EAST), None, "loc>=2"),
        (Condition(to=AT_G), Branch("1", move=WEST), None, "false"),
        (Condition(at=AT_B, to=AT_G), Branch("1", move=EAST), None, "loc=2"),
        (Condition(modes=NOT_SCANNING), Branch("1"), None, "(mode=0 | mode=2)"),
        (Condition(modes=SCANNED), Branch("1"), 2, "true"),
        (Condition(modes=SCANNED), Branch("1"), 1, "false"),
        (Condition(to_modes=SCANNED), Branch("1", mode=2), 1, "true"),
        (Condition(to_modes=SCANNED), Branch("1", mode=1), 1, "false"),
        (Condition(to_modes=SCANNED), Branch("1", move=EAST), None, "mode=2"),
        (Condition(at=AT_G, modes=SCANNED), Branch("1"), None, "(loc=3 & mode=2)"),
        (Condition(where=parsed("light = 0 & mode = 0")), Branch("1"), None, "(attribute_light=0 & mode=0)"),
        (Condition(where=parsed("light = 0 & mode = 0")), Branch("1"), 1, "false"),
        (Condition(at=AT_G, where=parsed("light < 1 | ice")), Branch("1"), None,
         "(loc=3 & (attribute_light<1 | attribute_ice))"),
    ],
)  # fmt: skip
def test_conditions(condition: Condition, branch: Branch, mode: int | None, expected: str) -> None:
    assert writer().holds(condition, "go", branch, mode) == expected


def pay(*rules: RewardRule, action: str = "go") -> str:
    steps = writer(with_objective(graph_combination(), rules=rules))
    capability = steps.combination.capability
    if action == "measure":
        assert capability.innate is not None
        return steps.pay(steps.innate(capability.innate.actions[0]))
    return steps.pay([steps.external(next(entry for entry in capability.external if entry.name == action))])


def test_what_an_action_pays() -> None:
    goal, rest = RewardRule(Condition(to=AT_G), number(5)), RewardRule(Condition(), number("-0.5"))
    assert pay() == "0"
    assert pay(rest, action="jump") == "-1/2"
    assert pay(goal, rest, action="back") == "-1/2"
    # across leads from S to B, staying there is no step to G but from G itself
    assert pay(goal, rest, action="jump") == "(loc=3 ? 5 : -1/2)"
    entering = RewardRule(Condition(at=AT_B, to=AT_G), number(5))
    assert pay(entering, rest, action="jump") == "-1/2"
    assert pay(rest, goal, action="jump") == "-1/2"
    across = RewardRule(Condition(to=AT_B), number(5))
    assert pay(across, rest, action="jump") == "(1/2 * (loc=0 | loc=2 ? 5 : -1/2) + 1/2 * (loc=2 ? 5 : -1/2))"
    assert pay(RewardRule(Condition(to_modes=SCANNED), number(3)), action="measure") == "(9/10 * 3)"
    assert pay(RewardRule(Condition(to_modes=SCANNED), number(3)), rest, action="measure") == (
        "(9/10 * 3 + 1/10 * (-1/2))"
    )


def test_an_innate_action_pays_by_its_mode() -> None:
    graph = graph_combination()
    assert graph.capability.innate is not None
    rows = {0: {1: Fraction(1)}, 1: {2: Fraction(1)}}
    innate = replace(graph.capability.innate, actions=(InnateAction("measure", rows),))
    combination = with_objective(
        with_capability(graph, innate=innate), rules=(RewardRule(Condition(), parsed("mode' - 3 * mode")),)
    )
    steps = writer(combination)
    assert steps.pay(steps.innate(innate.actions[0])) == "(mode=0 ? 1 : -1)"


def test_an_exact_zero_is_dropped_but_a_tiny_constant_is_not() -> None:
    tiny = Outcome(None, Constant(Fraction(1, 10**15)))
    action = ExternalAction("go", (Outcome(EAST, Constant(1 - Fraction(1, 10**15))), tiny), "stay")
    assert [branch.probability for branch in writer().external(action).branches] == [
        "0.999999999999999",
        "1e-15",
    ]
