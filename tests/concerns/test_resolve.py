"""What the parts of a case file become: expected values are read off the examples by hand."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from merap.checker.obstruction import goal_locations
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.concerns.external_action import ExternalAction
from merap.errors import InputError
from merap.families.models import explored
from merap.program.expressions import Constant, evaluate, render
from tests.support.case_examples import GRAPH, GRID, replaced, write_case


@pytest.fixture
def grid(tmp_path: Path) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path, GRID))


@pytest.fixture
def graph(tmp_path: Path) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path, GRAPH))


def external(case: DeclaredCase, capability: str, action: str) -> ExternalAction:
    index = case.supports.capability.index(capability)
    assert index is not None
    return next(found for found in case.supports.capability[index].external if found.name == action)


def outcomes(action: ExternalAction) -> list[tuple[int | None, str]]:
    return [(outcome.move, render(outcome.probability)) for outcome in action.outcomes]


def test_a_grid(grid: DeclaredCase) -> None:
    space = grid.space
    assert space.shape == (3, 3)
    assert space.locations[:4] == ("r0c0", "r0c1", "r0c2", "r1c0")
    assert space.moves == ("up", "down", "left", "right")
    assert space.target[4].tolist() == [1, 7, 3, 5]
    assert space.target[0].tolist() == [-1, 3, -1, 1]
    assert space.positions[5].tolist() == [2, -1]
    assert space.valuations[5].tolist() == [1, 2]


def test_a_graph(graph: DeclaredCase) -> None:
    space = graph.space
    assert space.shape is None
    assert space.locations == ("S", "A", "B", "G")
    assert space.moves == ("east", "north", "south", "west")
    assert space.target.tolist() == [[1, 2, -1, -1], [3, -1, -1, 0], [-1, -1, 3, -1], [-1, -1, -1, 1]]
    assert space.positions.tolist() == [[0, 0], [1, 0], [1, 1], [2, 0]]
    (lidar,) = space.detectors
    assert (lidar.name, lidar.of, lidar.range, lidar.accuracy) == ("lidar", "blocked", 1, 0.95)


def test_attributes(graph: DeclaredCase) -> None:
    light, slippery, slope = graph.space.attributes
    assert (light.kind, light.low, light.high, light.values.tolist()) == ("int", 0, 3, [2, 2, 0, 2])
    assert (slippery.kind, slippery.values.tolist()) == ("bool", [0, 1, 1, 0])
    assert (slope.kind, slope.values.tolist()) == ("real", [0.25] * 4)


def test_a_configuration_sets_attributes(graph: DeclaredCase) -> None:
    bright, dim = graph.supports.environment
    assert [bright.name, dim.name] == ["open", "dim"]
    assert bright.attributes[0].values.tolist() == [2, 3, 0, 2]
    assert dim.attributes[0].values.tolist() == [2, 1, 0, 2]
    assert dim.blocked.tolist() == [False, False, True, False]
    assert np.argwhere(dim.blocked_edges).tolist() == [[1, 3]]
    assert dim.parameters == {"blocked": ["B"], "blocked_edges": [["A", "S", "west"]], "lamp": 1}


def test_attributes_are_shared_by_configurations_that_set_them_alike(tmp_path: Path) -> None:
    text = replaced(GRAPH, "lamp: 1}\n", "lamp: 1}\n    dim_too: {blocked: [], blocked_edges: [], lamp: 1}\n")
    bright, dim, too = load_declared_case(write_case(tmp_path, text)).supports.environment
    assert dim.attributes is too.attributes is not bright.attributes


def test_a_parameter_may_say_where_an_attribute_is_set(tmp_path: Path) -> None:
    text = replaced(GRAPH, "lamp: int}", "lamp: int, dark: locations}")
    text = replaced(text, "{light: {A: lamp}}", "{light: [{at: dark, value: 0}, {at: [A], value: lamp}]}")
    text = replaced(text, "blocked_edges: [], lamp: 3}", "blocked_edges: [], lamp: 3, dark: [S, A]}")
    text = replaced(text, "lamp: 1}", "lamp: 1, dark: []}")
    case = load_declared_case(write_case(tmp_path, text[: text.index("online:")]))
    assert [environment.attributes[0].values.tolist() for environment in case.supports.environment] == [
        [0, 3, 0, 2],
        [2, 1, 0, 2],
    ]


def test_forms_of_actions(graph: DeclaredCase) -> None:
    east, north, south = graph.space.moves.index("east"), 1, 2
    assert outcomes(external(graph, "slow", "stop")) == [(None, "1")]
    assert outcomes(external(graph, "slow", "north")) == [(north, "9/10"), (east, "1/10")]
    assert outcomes(external(graph, "slow", "south")) == [(south, "9/10"), (None, "1/10")]
    assert outcomes(external(graph, "slow", "east")) == [
        (east, "slippery' ? 9/20 : 9/10"),
        (None, "1 - (slippery' ? 9/20 : 9/10)"),
    ]


def test_a_sure_move_has_one_outcome_and_the_intended_one_stays(tmp_path: Path, grid: DeclaredCase) -> None:
    up = external(grid, "no_entry_r2c0", "up")
    assert outcomes(up) == [(0, "1")]
    assert up.on_blocked == "stay"
    assert external(grid, "no_entry_r2c0", "right").on_blocked == "disable"
    broken = load_declared_case(write_case(tmp_path, replaced(GRAPH, "{grip: 0.8,", "{grip: 0,")))
    assert outcomes(external(broken, "fast", "north")) == [(1, "0"), (0, "1")]


def test_primes_read_where_the_intended_move_leads(graph: DeclaredCase) -> None:
    """S -east-> A is slippery there, A -east-> G is not: 0.9 / 2 and 0.9 (configuration slow)."""
    combination = graph.combination("open.slow.g")
    mdp = explored(combination)
    east = mdp.action_names.index("east")
    chosen = (mdp.choice_action == east)[mdp.branch_choice]
    moved = mdp.valuations[mdp.branch_target, 0] != mdp.valuations[mdp.choice_state[mdp.branch_choice], 0]
    source = mdp.valuations[mdp.choice_state[mdp.branch_choice], 0]
    for location, probability in ((0, 0.45), (1, 0.9)):
        found = mdp.branch_prob[chosen & moved & (source == location)]
        np.testing.assert_allclose(found, probability, rtol=1e-12)


def test_requires_takes_actions_and_the_automaton_away(graph: DeclaredCase) -> None:
    slow, fast = graph.supports.capability
    assert [action.name for action in slow.external] == ["stop", "east", "north", "south", "west"]
    assert [action.name for action in fast.external] == ["stop", "east", "north", "south"]
    assert fast.innate is None
    assert fast.terminal(3).tolist() == [True, True, True]
    assert fast.initial_mode == 0


def test_the_innate_automaton(graph: DeclaredCase) -> None:
    innate = graph.supports.capability[0].innate
    assert innate is not None
    assert (innate.name, innate.entry, innate.initial, innate.terminal) == ("scan", 1, 0, frozenset({0, 2}))
    assert innate.restart
    assert innate.start_action == "start_scan"
    (measure,) = innate.actions
    assert measure.chances == {1: {2: Fraction(9, 10), 1: Fraction(1, 10)}}


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("    terminal: [idle, scanned]\n", True),
        ("", False),
        ("    terminal: [idle, scanned]\n    restart: false\n", False),
        ("    restart: true\n", True),
    ],
)
def test_restart_defaults_to_whether_some_mode_is_not_terminal(
    tmp_path: Path, lines: str, expected: bool
) -> None:
    case = load_declared_case(write_case(tmp_path, replaced(GRAPH, "    terminal: [idle, scanned]\n", lines)))
    innate = case.supports.capability[0].innate
    assert innate is not None
    assert innate.restart == expected
    assert ("start_scan" in case.actions) == expected


def test_a_probability_of_zero_is_no_transition(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, replaced(GRAPH, "slow: {grip: 0.9,", "slow: {grip: 1,")))
    innate = case.supports.capability[0].innate
    assert innate is not None
    assert innate.actions[0].chances == {1: {2: Fraction(1)}}


def test_start_and_goal(graph: DeclaredCase) -> None:
    g, ab = graph.supports.objective
    at_g, at_ab = (goal_locations(graph.combine(0, 0, index)) for index in (0, 1))
    assert g.start.tolist() == [0.75, 0.25, 0, 0]
    assert at_g.tolist() == [False, False, False, True]
    assert at_ab.tolist() == [False, True, True, False]
    assert (g.horizon, g.properties) == (12, {"soon": 'Pmax>=0.5 [F<=12 "goal"]'})
    assert ab.parameters == {"goal": ["A", "B"], "bonus": -1.0}


def test_an_online_system_may_start_elsewhere(graph: DeclaredCase) -> None:
    met = graph.system("met").objective
    assert met.start.tolist() == [1, 0, 0, 0]
    assert met.horizon == 20


@pytest.mark.parametrize("reset", ["episodes", "return_to_start", "none"])
def test_an_online_system_may_not_be_resettable(tmp_path: Path, reset: str) -> None:
    text = replaced(GRAPH, "    horizon: 20\n", f"    reset: {reset}\n")
    case = load_declared_case(write_case(tmp_path, text))
    assert case.system("met").reset == reset
    assert case.combination_at(0).reset == "episodes"


def test_a_start_may_be_a_parameter(tmp_path: Path) -> None:
    text = replaced(
        GRID, "parameters: {goal: location}", "parameters: {goal: location, from_where: location}"
    )
    text = replaced(text, "start: [0, 0]", "start: from_where")
    text = replaced(
        text, "{from: [[2, 2], [0, 2]]}", "{from: [[2, 2]]}, from_where: {from: [[0, 0], [2, 1]]}"
    )
    text = replaced(text, "from: [[2, 0], [2, 1]]", "from: [[2, 0], [1, 1]]")
    case = load_declared_case(write_case(tmp_path, text[: text.index("online:")]))
    assert list(case.supports.objective.names()) == [
        "goal_r2c2__from_where_r0c0",
        "goal_r2c2__from_where_r2c1",
    ]
    assert [int(np.argmax(objective.start)) for objective in case.supports.objective] == [0, 7]


def test_rules_and_conditions(graph: DeclaredCase) -> None:
    objective = graph.supports.objective[0]
    reach, _, back, other = objective.rules
    assert reach.value == Constant(Fraction(21, 2))
    assert reach.condition.actions == frozenset({"stop"})
    conditions = [render(rule.condition.where) for rule in objective.rules]
    assert conditions == [
        "at(goal) & (mode = 0 | mode = 2)",
        "at'(B) & (light' = 0 & mode' = mode)",
        "mode' = 0",
        "true",
    ]
    assert evaluate(back.value, {"light": np.array([0, 3])}).tolist() == [-4, -1]
    assert other.value == Constant(Fraction(-1))


def test_ends_and_unsafe(graph: DeclaredCase) -> None:
    objective = graph.supports.objective[1]
    assert objective.ends_after is not None
    assert objective.ends_after.actions == frozenset({"stop"})
    assert objective.ends_in is not None
    assert objective.ends_in is not None
    assert render(objective.ends_in) == "at(goal) & mode = 2 & light > 0"
    assert objective.unsafe is not None
    assert objective.unsafe is not None
    assert render(objective.unsafe) == "light = 0 & mode != 1"


def test_arrays_are_read_only(graph: DeclaredCase) -> None:
    combination = graph.combination_at(0)
    for array in (
        combination.space.target,
        combination.space.positions,
        combination.environment.blocked,
        combination.environment.blocked_edges,
        combination.environment.attributes[0].values,
        combination.capability.no_entry,
        combination.objective.start,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_distributions_are_checked_for_every_attribute_of_an_environment(tmp_path: Path) -> None:
    """The second environment alone makes the probability wrong: its lamp gives A a light of 1."""
    text = replaced(GRAPH, "probability: grip, otherwise: east", 'probability: "light = 1 ? 1.5 : grip"')
    with pytest.raises(InputError) as caught:
        load_declared_case(write_case(tmp_path, text))
    assert "has the probability 1.5, not in [0, 1], at location A in mode idle" in caught.value.message
    assert "(environment dim, capability slow)" in caught.value.message


def test_large_supports_are_checked_when_a_combination_is_asked_for(tmp_path: Path) -> None:
    """3,000 capabilities; the last has a probability above 1."""
    levels = ", ".join(str(level) for level in range(3000))
    text = replaced(GRID, "parameters: {no_entry: locations}", "parameters: {level: int}")
    text = replaced(text, "up: {move: up}", 'up: {move: up, probability: "level < 2999 ? 1 : 2"}')
    text = replaced(text, "no_entry: {choose: 1, from: [[2, 0], [2, 1]]}", f"level: {{from: [{levels}]}}")
    case = load_declared_case(write_case(tmp_path, text[: text.index("online:")]))
    assert case.combination("blocked_r1c0_r1c1.level_2998.goal_r2c2").name
    with pytest.raises(InputError, match=r"has the probability 2, not in \[0, 1\].*capability level_2999"):
        case.combination("blocked_r1c0_r1c1.level_2999.goal_r2c2")
