"""Combinations over large random spaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.concerns.combination import Combination, Condition, RewardRule
from merap.concerns.space import Attribute, Space
from tests.support.hand_made import at, graph_combination, grid_combination, number, parsed


def random_graph(size: int) -> Combination:
    generator = np.random.default_rng(size)
    graph = graph_combination()
    light = Attribute("light", "int", 0, 3, generator.integers(0, 4, size=size).astype(np.float64))
    ice = Attribute("ice", "bool", 0, 1, (generator.random(size) < 0.3).astype(np.float64))
    target = generator.integers(-1, size, size=(size, 3))
    start, goal = np.zeros(size), np.zeros(size, dtype=np.bool_)
    start[0], goal[size - 1] = 1, True
    return replace(
        graph,
        space=Space(
            tuple(f"n{index}" for index in range(size)),
            np.zeros((size, 2)),
            graph.space.moves,
            target,
            None,
            (ice, light),
            (),
        ),
        environment=replace(
            graph.environment,
            blocked=(generator.random(size) < 0.1) & (start == 0),
            blocked_edges=np.zeros((size, 3), dtype=np.bool_),
            attributes=(ice, light),
        ),
        capability=replace(graph.capability, no_entry=np.zeros(size, dtype=np.bool_)),
        objective=replace(
            graph.objective,
            start=start,
            goal=at(goal),
            rules=(
                RewardRule(Condition(frozenset({"stop"}), at(goal)), number(20)),
                RewardRule(Condition(where=parsed("light' = 0")), number(-2)),
                RewardRule(Condition(), number(-1)),
            ),
            ends_after=Condition(frozenset({"stop"}), at(goal)),
            ends_in=None,
        ),
    )


def random_grid(size: int) -> Combination:
    blocked = np.random.default_rng(size).random(size * size) < 0.3
    blocked[0] = False
    return grid_combination(size=size, blocked=blocked, goal=(size - 1, size - 1))
