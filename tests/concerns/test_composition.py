"""Combinations composed as programs and explored, against the definition on arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.concerns.combination import Combination, Condition, RewardRule
from merap.concerns.composition import compose
from merap.concerns.synthesis import synthesise
from merap.errors import ModelError
from merap.mdp.comparison import compare
from merap.program.arrays import tabular
from merap.program.exploration import explore
from tests.support.hand_made import HAND_MADE, graph_combination, parsed, with_capability, with_objective
from tests.support.large_spaces import random_graph, random_grid
from tests.support.random_combinations import random_combination


def require_agreement(combination: Combination) -> None:
    """States by valuation, actions, probabilities (1e-12), rewards (1e-9), labels and initial states."""
    program = compose(combination)
    explored, defined = tabular(program, explore(program), reward="objective"), synthesise(combination)
    compare(explored, defined).require_same()
    assert set(explored.labels) == set(defined.labels)


@pytest.mark.parametrize("name", HAND_MADE)
def test_exploration_finds_what_is_defined(name: str) -> None:
    require_agreement(HAND_MADE[name])


@pytest.mark.parametrize("seed", range(100, 180))
def test_exploration_finds_what_is_defined_of_random_combinations(seed: int) -> None:
    require_agreement(random_combination(seed))


@pytest.mark.parametrize("combination", [random_graph(500), random_grid(40)], ids=["graph", "grid"])
def test_exploration_finds_what_is_defined_of_large_spaces(combination: Combination) -> None:
    require_agreement(combination)


def test_steps_count_until_completion() -> None:
    program = compose(graph_combination())
    counted = tabular(program, explore(program), reward="steps")
    complete = counted.labels["done"][counted.choice_state]
    assert np.array_equal(counted.choice_reward, np.where(complete, 0.0, 1.0))


def test_a_condition_need_not_be_defined_where_the_rest_does_not_hold() -> None:
    # light is 0 at B alone
    elsewhere = np.array([True, True, False, True])
    rule = RewardRule(Condition(at=elsewhere, where=parsed("1 / light > 0.4")), parsed("2 / light"))
    require_agreement(with_objective(graph_combination(), rules=(rule,)))


def test_a_reachable_state_without_action_is_refused() -> None:
    graph = graph_combination()
    only_back = with_capability(graph, external=graph.capability.external[2:3], innate=None)
    program = compose(replace(only_back, name="e.c.o"))
    with pytest.raises(
        ModelError, match=r"^e.c.o: state \(loc=S, mode=idle, done=false\) can be reached and has no action$"
    ):
        tabular(program, explore(program))
