from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.checker.obstruction import obstruction
from merap.concerns.combination import DeclaredCombination
from merap.concerns.external_action import ExternalAction, Outcome
from tests.support.hand_made import (
    at,
    cells,
    graph_combination,
    grid_combination,
    number,
    with_capability,
    with_environment,
    with_objective,
)

# A wall around the goal (4, 4): three obstacles and one cell that can't be entered.
WALL = cells((3, 4), (5, 4), (4, 3))


def walled(*extra: tuple[int, int]) -> DeclaredCombination:
    return grid_combination(blocked=WALL | cells(*extra), no_entry=cells((4, 5)))


def test_an_open_way_is_no_obstruction() -> None:
    assert obstruction(grid_combination()) is None
    assert obstruction(graph_combination()) is None


def test_what_stands_around_the_goal_is_named_with_its_concern() -> None:
    assert obstruction(walled()) == (
        "cut off by blocked r3c4, r4c3, r5c4 (environment e); no entry to r4c5 (capability c)"
    )


def test_obstacles_that_cut_nothing_off_are_not_named() -> None:
    # an obstacle in the open, and one behind the wall where nobody gets to
    assert obstruction(walled((0, 3), (7, 7))) == obstruction(walled())


def test_all_layers_between_start_and_goal_are_opened_from_the_start() -> None:
    # a wall in row 2 before the wall in row 6: only the first is at the border of what can be reached
    rows = [(row, column) for row in (2, 6) for column in range(9)]
    first = [f"r2c{column}" for column in range(9)]
    text = obstruction(grid_combination(blocked=cells(*rows), goal=(8, 8)))
    assert text == f"cut off by blocked {', '.join(first)} (environment e)"


def test_a_long_list_is_shortened() -> None:
    size = 20
    wall = cells(*((1, column) for column in range(size)), size=size)
    text = obstruction(grid_combination(size=size, blocked=wall, goal=(9, 9)))
    assert text is not None
    assert text.endswith("r1c10, r1c11 and 8 more (environment e)")


def only_goal_at(location: int, combination: DeclaredCombination) -> DeclaredCombination:
    goal = at(np.arange(4) == location)
    return with_objective(combination, goal=goal, start=np.array([1.0, 0.0, 0.0, 0.0]))


def test_blocked_edges_are_named_by_their_ends() -> None:
    edges = np.zeros((4, 3), dtype=np.bool_)
    edges[2, 0] = True
    combination = only_goal_at(3, with_environment(graph_combination(), blocked_edges=edges))
    assert obstruction(combination) == "cut off by blocked edges B to G (environment e)"


def test_an_edge_of_two_labels_is_named_once() -> None:
    graph = graph_combination()
    target = graph.space.target.copy()
    target[2, 1] = target[2, 0]
    twofold = replace(graph, space=replace(graph.space, target=target))
    edges = np.zeros((4, 3), dtype=np.bool_)
    edges[2, :2] = True
    combination = only_goal_at(3, with_environment(twofold, blocked_edges=edges))
    assert obstruction(combination) == "cut off by blocked edges B to G (environment e)"


def test_moves_that_no_action_makes_are_named() -> None:
    graph = graph_combination()
    west = ExternalAction("back", (Outcome(1, number(1)),), "stay")
    never_east = ExternalAction("go", (Outcome(0, number(0)), Outcome(None, number(1))), "stay")
    combination = only_goal_at(3, with_capability(graph, external=(west, never_east)))
    assert obstruction(combination) == "cut off by no action goes across, east (capability c)"
    # from B the way on is east
    jumping = with_capability(combination, external=(*graph.capability.external[3:], west, never_east))
    assert obstruction(jumping) == "cut off by no action goes east (capability c)"


def test_a_goal_without_a_way_in_is_nobody_s_fault() -> None:
    graph = graph_combination()
    island = np.where(graph.space.target == 3, -1, graph.space.target)
    assert obstruction(only_goal_at(3, replace(graph, space=replace(graph.space, target=island)))) == (
        "no edges lead to G, even with nothing blocked"
    )


def test_an_objective_without_goal_says_so() -> None:
    combination = with_objective(graph_combination(), goal=None)
    assert obstruction(combination) == "the objective declares no goal at a location"


@pytest.mark.parametrize(("start", "open_way"), [(0, False), (3, True)])
def test_one_start_that_gets_there_is_enough(start: int, open_way: bool) -> None:
    blocked = np.array([False, True, True, False])
    weights = np.zeros(4)
    weights[[0, start]] = 1 / len({0, start})
    combination = with_objective(with_environment(graph_combination(), blocked=blocked), start=weights)
    assert (obstruction(combination) is None) == open_way


def test_every_obstacle_is_named_once() -> None:
    twice = grid_combination(blocked=WALL, no_entry=cells((4, 5), (3, 4)))
    into_the_wall = np.isin(twice.space.target, [3 * 9 + 4, 4 * 9 + 5])
    assert obstruction(with_environment(twice, blocked_edges=into_the_wall)) == obstruction(walled())
