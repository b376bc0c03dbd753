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
from merap.concerns.expressions import Constant
from merap.concerns.space import Attribute
from merap.prism.lines import Formula
from merap.prism.step_text import Branch, StepWriter
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
    assert writer().expression(parsed(text), move) == expected


def test_a_mode_that_is_known_is_put_in() -> None:
    text = parsed("mode = 1 & mode' = 2 ? light : 0")
    assert writer().expression(text, None, before=1, after=2) == "attribute_light"
    assert writer().expression(text, None, before=1) == "0"
    assert writer().expression(text, None, before=0, after=2) == "0"


def test_attributes_become_formulas_once() -> None:
    steps = writer()
    steps.expression(parsed("light' + light"), EAST)
    # light is 3, 2, 0, 2 at S, A, B, G; east leads to A, B, G and from G nowhere
    assert steps.take_attributes() == [
        Formula("attribute_light", "loc=0 ? 3 : loc=2 ? 0 : 2"),
        Formula("attribute_light_east", "loc=1 ? 0 : 2"),
    ]
    steps.expression(parsed("ice' ? light : 0"), WEST)
    # west from G is B; S has no way west
    assert steps.take_attributes() == [Formula("attribute_ice_west", "false")]
    assert steps.take_attributes() == []


def test_a_blocked_move_reads_the_own_location() -> None:
    blocked = with_environment(graph_combination(), blocked=AT_G)
    steps = writer(blocked)
    steps.expression(parsed("ice' ? 1 : 0"), EAST)
    assert steps.take_attributes() == [Formula("attribute_ice_east", "loc=3")]


def test_attributes_and_labels_that_make_one_name_are_told_apart() -> None:
    graph = graph_combination()
    low, high = np.zeros(4), np.array([0.0, 1.0, 1.0, 1.0])
    attributes = (Attribute("ice", "bool", 0, 1, low), Attribute("ice_far", "bool", 0, 1, high))
    space = replace(graph.space, moves=("far_east", "east", "across"))
    steps = writer(with_environment(replace(graph, space=space), attributes=attributes))
    assert steps.expression(parsed("ice'"), 0) == "attribute_ice_far_east"
    assert steps.expression(parsed("ice_far'"), 1) == "attribute_ice_far_east_"
    assert steps.expression(parsed("ice'"), 0) == "attribute_ice_far_east"
    assert [formula.name for formula in steps.take_attributes()] == [
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


def test_arithmetic_that_ends_in_zero_says_so() -> None:
    # light is 3 at S: 0.4 + 0.2 * 3 is 1 but for rounding, and Storm makes a branch of -1.1e-16
    rest = Outcome(None, parsed("1 - (0.4 + 0.2 * light)"))
    action = ExternalAction("go", (Outcome(EAST, parsed("0.4 + 0.2 * light")), rest), "stay")
    assert [branch.probability for branch in writer().external(action).branches] == [
        "(2/5 + 1/5 * attribute_light)",
        "(loc=0 ? 0 : (1 - (2/5 + 1/5 * attribute_light)))",
    ]


def test_arithmetic_that_ends_in_zero_in_one_mode_says_so_there() -> None:
    # external actions are possible in the modes 0 and 2; light is 0 at B
    action = ExternalAction("go", (Outcome(EAST, parsed("mode * light / 6")),), "stay")
    (branch,) = writer().external(action).branches
    assert branch.probability == "((loc=2 & mode=2) | (mode=0 | mode=1) ? 0 : (mode * attribute_light / 6))"


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
