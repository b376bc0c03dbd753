"""Combinations composed as programs and explored: what the rules of composition say, by hand."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from merap.concerns.combination import Condition, DeclaredCombination
from merap.concerns.composition import compose
from merap.concerns.external_action import ExternalAction, Outcome
from merap.errors import ModelError
from merap.families.models import explored
from merap.mdp.model import TabularMDP
from merap.mdp.planning import optimum
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.program.expressions import Constant
from tests.support.hand_made import (
    at,
    cells,
    graph_combination,
    grid_combination,
    number,
    parsed,
    with_capability,
    with_environment,
    with_objective,
)
from tests.support.mdp_lookup import enabled_in, reward, step

IDLE, SCANNING, SCANNED = 0, 1, 2
S, A, B, G = 0, 1, 2, 3


def unending(combination: DeclaredCombination) -> TabularMDP:
    """The model in which an episode may begin anywhere and nothing ends it: `done` is left out."""
    start = np.full(combination.space.num_locations, 1 / combination.space.num_locations)
    mdp = explored(with_objective(combination, start=start, rules=(), ends_in=None, ends_after=None))
    return replace(mdp, valuations=mdp.valuations[:, :-1], variable_names=mdp.variable_names[:-1])


# --- the paper's world: closed forms of shared/paper/README.md ---


def test_the_paper_grid_folds_to_its_82_states() -> None:
    mdp = explored(grid_combination())
    # 81 cells not done and, done, the goal alone with its 4 neighbours: any action there ends the task
    assert mdp.num_states == 81 + 5
    assert mdp.action_names == ("stop", "up", "down", "left", "right", "end")
    assert mdp.variable_names == ("row", "col", "mode", "done")


@pytest.mark.parametrize(("goal", "distance"), [((4, 4), 8), ((0, 8), 8), ((3, 6), 9), ((2, 2), 4)])
def test_the_optimum_is_ten_less_half_the_distance(goal: tuple[int, int], distance: int) -> None:
    assert optimum(explored(grid_combination(goal=goal)), horizon=18) == 10 - 0.5 * distance


def test_obstacles_and_no_entry_make_detours() -> None:
    # RQ1-4 as it is met online: optimum 6, so the shortest path still has 8 steps
    met = grid_combination(blocked=cells((1, 2), (3, 2), (4, 1), (6, 1)), no_entry=cells((4, 3)))
    assert optimum(explored(met), horizon=18) == 6
    # a wall in row 1 from column 0 to 7 leaves column 8: 8 + 4 + 4 steps instead of 8
    wall = grid_combination(blocked=cells(*((1, column) for column in range(8))))
    assert optimum(explored(wall), horizon=18) == 10 - 0.5 * 16


def test_passing_through_the_goal_without_stop_ends_without_the_prize() -> None:
    mdp = explored(grid_combination())
    assert step(mdp, (4, 4, 0, 0), "up") == {(3, 4, 0, 1): 1.0}
    assert reward(mdp, (4, 4, 0, 0), "up") == -0.5
    assert step(mdp, (4, 4, 0, 0), "stop") == {(4, 4, 0, 1): 1.0}
    assert reward(mdp, (4, 4, 0, 0), "stop") == 10
    assert enabled_in(mdp, 3, 4, 0, 1) == {"end"}


# --- rule 1: external actions ---


def test_the_edge_of_the_grid_blocks() -> None:
    mdp = explored(grid_combination())
    assert step(mdp, (0, 0, 0, 0), "up") == {(0, 0, 0, 0): 1.0}
    assert step(mdp, (0, 0, 0, 0), "right") == {(0, 1, 0, 0): 1.0}


@pytest.mark.parametrize("concern", ["blocked", "no_entry"])
def test_a_closed_location_is_never_entered_but_can_be_left(concern: str) -> None:
    if concern == "blocked":
        closed = grid_combination(blocked=cells((0, 1)))
    else:
        closed = grid_combination(no_entry=cells((0, 1)))
    mdp = unending(closed)
    assert step(mdp, (0, 0, 0), "right") == {(0, 0, 0): 1.0}
    assert step(mdp, (1, 1, 0), "up") == {(1, 1, 0): 1.0}
    assert step(mdp, (0, 1, 0), "down") == {(1, 1, 0): 1.0}


def test_a_blocked_edge_blocks_one_way() -> None:
    edges = np.zeros((4, 3), dtype=np.bool_)
    edges[A, 0] = True
    mdp = unending(with_environment(graph_combination(), blocked_edges=edges))
    # B is icy nowhere near, so `go` succeeds with 0.9
    assert step(mdp, (A, IDLE), "go") == {(A, IDLE): 1.0}
    assert step(mdp, (B, IDLE), "back") == {(A, IDLE): 1.0}


def test_outcomes_by_hand() -> None:
    mdp = unending(graph_combination())
    # light at S is 3: 0.6; idle: no way back
    assert step(mdp, (S, IDLE), "go") == {(A, IDLE): 0.6, (S, IDLE): 0.4}
    # scanned: 0.05 would go west, which S has not, so it stays and adds to 0.35
    assert step(mdp, (S, SCANNED), "go") == pytest.approx({(A, SCANNED): 0.6, (S, SCANNED): 0.4})
    assert step(mdp, (A, SCANNED), "go") == pytest.approx(
        {(B, SCANNED): 0.9, (S, SCANNED): 0.05, (A, SCANNED): 0.05}
    )
    # ice' reads the target G of the intended edge
    assert step(mdp, (B, IDLE), "go") == pytest.approx({(G, IDLE): 0.6, (B, IDLE): 0.4})


def test_a_prime_reads_the_own_location_where_the_intended_move_is_blocked() -> None:
    blocked = np.array([False, False, False, True])
    action = ExternalAction(
        "go", (Outcome(0, parsed("ice' ? 0.5 : 1")), Outcome(1, parsed("ice' ? 0.5 : 0"))), "stay"
    )
    open_way = with_capability(graph_combination(), external=(action,))
    assert step(unending(open_way), (B, IDLE), "go") == {(G, IDLE): 0.5, (A, IDLE): 0.5}
    cut = with_environment(open_way, blocked=blocked)
    assert step(unending(cut), (B, IDLE), "go") == {(B, IDLE): 1.0}


def test_disable_looks_at_the_first_outcome_alone() -> None:
    def with_outcomes(*moves: int | None) -> TabularMDP:
        action = ExternalAction("go", tuple(Outcome(move, number("0.5")) for move in moves), "disable")
        return unending(with_capability(graph_combination(), external=(action,)))

    # S has no way west (label 1)
    assert "go" not in enabled_in(with_outcomes(1, 0), S, IDLE)
    assert step(with_outcomes(0, 1), (S, IDLE), "go") == {(A, IDLE): 0.5, (S, IDLE): 0.5}
    assert step(with_outcomes(None, 1), (S, IDLE), "go") == {(S, IDLE): 1.0}


def test_an_impossible_first_outcome_still_says_what_is_intended() -> None:
    action = ExternalAction("go", (Outcome(1, number(0)), Outcome(0, number(1))), "disable")
    mdp = unending(with_capability(graph_combination(), external=(action,)))
    assert "go" not in enabled_in(mdp, S, IDLE)
    assert step(mdp, (A, IDLE), "go") == {(B, IDLE): 1.0}


def test_what_is_left_by_rounding_is_no_outcome() -> None:
    # 1 - 0.9 - 0.1 is -2.8e-17 in doubles; light is 3 at S
    outcomes = (
        Outcome(0, parsed("0.3 * light")),
        Outcome(1, parsed("light / 30")),
        Outcome(2, parsed("1 - 0.3 * light - light / 30")),
    )
    combination = with_capability(graph_combination(), external=(ExternalAction("go", outcomes, "stay"),))
    assert step(unending(combination), (S, IDLE), "go") == pytest.approx({(A, IDLE): 0.9, (S, IDLE): 0.1})


# --- rules 2 and 3: modes ---


def test_external_actions_need_a_terminal_mode_and_innate_ones_their_row() -> None:
    mdp = unending(graph_combination())
    assert enabled_in(mdp, A, IDLE) == {"stop", "go", "back", "start_scan"}
    assert enabled_in(mdp, A, SCANNING) == {"measure"}
    assert enabled_in(mdp, S, SCANNED) == {"stop", "go", "jump", "start_scan"}
    assert step(mdp, (A, SCANNING), "measure") == {(A, SCANNED): 0.9, (A, SCANNING): 0.1}
    assert step(mdp, (A, SCANNED), "start_scan") == {(A, SCANNING): 1.0}


def test_without_restart_there_is_no_start_action() -> None:
    graph = graph_combination()
    assert graph.capability.innate is not None
    once = with_capability(graph, innate=replace(graph.capability.innate, restart=False, initial=SCANNING))
    mdp = explored(once)
    assert "start_scan" not in {mdp.action_names[action] for action in mdp.choice_action}
    assert enabled_in(mdp, S, SCANNING, 0) == {"measure"}


def test_a_capability_without_innate_part_stays_in_the_first_mode() -> None:
    mdp = explored(with_capability(graph_combination(), innate=None))
    assert mdp.variable_names == ("loc", "mode", "done")
    assert set(mdp.valuations[:, 1].tolist()) == {0}
    assert enabled_in(mdp, B, IDLE, 0) == {"stop", "go", "back"}


# --- rule 4: ends ---


def test_ends_after_sets_done_with_a_step_that_still_moves() -> None:
    combination = with_objective(
        graph_combination(), ends_after=Condition(actions=frozenset({"go"})), ends_in=None
    )
    mdp = explored(combination)
    assert step(mdp, (S, IDLE, 0), "go") == {(A, IDLE, 1): 0.6, (S, IDLE, 1): 0.4}
    assert enabled_in(mdp, A, IDLE, 1) == {"end"}


def test_a_complete_state_has_the_action_end_alone() -> None:
    mdp = explored(graph_combination())
    # ends_in: at A, scanned
    assert enabled_in(mdp, A, SCANNED, 0) == {"end"}
    assert step(mdp, (A, SCANNED, 0), "end") == {(A, SCANNED, 0): 1.0}
    assert reward(mdp, (A, SCANNED, 0), "end") == 0
    assert "end" not in enabled_in(mdp, S, SCANNED, 0)
    done = mdp.labels["done"]
    ends = np.array([mdp.enabled[state, -1] for state in range(mdp.num_states)])
    assert np.array_equal(done, ends)


def test_an_initial_state_can_be_complete() -> None:
    combination = with_objective(graph_combination(), ends_in=at(np.array([True, True, False, False])))
    mdp = explored(combination)
    assert mdp.valuations.tolist() == [[S, IDLE, 0], [A, IDLE, 0]]
    assert mdp.labels["done"].all()
    assert mdp.initial.tolist() == [0.25, 0.75]


def test_labels_speak_of_location_mode_and_attributes() -> None:
    mdp = explored(graph_combination())
    location, mode = mdp.valuations[:, 0], mdp.valuations[:, 1]
    assert np.array_equal(mdp.labels["goal"], location == G)
    assert np.array_equal(mdp.labels["unsafe"], location == B)
    unsafe = parsed("light > 2 & mode = 1")
    mdp = explored(with_objective(graph_combination(), unsafe=unsafe))
    assert np.array_equal(mdp.labels["unsafe"], (location == S) & (mode == SCANNING))
    assert "unsafe" not in explored(with_objective(graph_combination(), unsafe=None)).labels


def test_steps_count_until_completion() -> None:
    program = compose(graph_combination())
    counted = tabular(program, explore(program), reward="steps")
    complete = counted.labels["done"][counted.choice_state]
    assert np.array_equal(counted.choice_reward, np.where(complete, 0.0, 1.0))


def test_start_distribution_and_initial_mode() -> None:
    mdp = explored(graph_combination())
    weight = dict(zip(map(tuple, mdp.valuations.tolist()), mdp.initial.tolist(), strict=True))
    assert weight[(S, IDLE, 0)] == 0.25
    assert weight[(A, IDLE, 0)] == 0.75
    assert sum(weight.values()) == 1


def test_a_reachable_state_without_action_is_named() -> None:
    graph = graph_combination()
    only_back = with_capability(graph, external=graph.capability.external[2:3], innate=None)
    with pytest.raises(
        ModelError, match=r"^e.c.o: state \(loc=S, mode=idle, done=false\) can be reached and has no action$"
    ):
        explored(only_back)


def test_a_dead_end_that_is_complete_or_out_of_reach_is_allowed() -> None:
    graph = graph_combination()
    only_back = with_capability(graph, external=(graph.capability.external[2],), innate=None)
    at_start = np.array([True, False, False, False])
    mdp = explored(with_objective(only_back, ends_in=at(at_start)))
    assert enabled_in(mdp, S, IDLE, 0) == {"end"}
    west = graph.space.target.copy()
    west[A, 1] = A
    turning = replace(only_back, space=replace(graph.space, target=west))
    turning = with_objective(turning, start=np.array([0.0, 1.0, 0.0, 0.0]))
    assert explored(turning).valuations.tolist() == [[A, IDLE, 0]]


def test_probabilities_that_are_exact_fractions_stay_exact() -> None:
    graph = graph_combination()
    thirds = tuple(Outcome(move, Constant(Fraction(1, 3))) for move in (0, 1, None))
    mdp = unending(with_capability(graph, external=(ExternalAction("go", thirds, "stay"),)))
    assert step(mdp, (A, IDLE), "go") == {(B, IDLE): 1 / 3, (S, IDLE): 1 / 3, (A, IDLE): 1 / 3}
