from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.concerns.combination import DeclaredCombination
from merap.errors import InputError
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.systems.return_policy import ReturnTrips, return_policy
from merap.systems.slip import slipping
from tests.support.hand_made import cells, graph_combination, grid_combination, with_capability

TRIPS = 2000


def trips(combination: DeclaredCombination, slip: float = 0.0) -> ReturnTrips:
    return ReturnTrips(combination, slipping(combination.program, slip))


def cell(row: int, column: int) -> dict[str, int]:
    return {"row": row, "col": column, "mode": 0, "done": 0}


@pytest.mark.parametrize(
    ("start", "end", "distance"),
    [((0, 0), (0, 0), 0), ((4, 4), (0, 0), 8), ((0, 0), (0, 2), 6)],
)
def test_without_chance_it_is_the_shortest_path(
    start: tuple[int, int], end: tuple[int, int], distance: int
) -> None:
    """A wall at column 1 in rows 0 and 1 makes the way from (0,0) to (0,2) two down, two right, two up."""
    combination = grid_combination(blocked=cells((0, 1), (1, 1)))
    found = trips(combination).travel(cell(*start), cell(*end), np.random.default_rng(0))
    assert found == distance


def test_a_slip_makes_it_longer() -> None:
    """A step succeeds with 1 - p: 8 / 0.8 = 10 steps expected.

    The variance is that of a negative binomial, 8 * 0.2 / 0.8^2 = 2.5. Within 4
    standard errors; fails by luck with less than 1 in 10,000.
    """
    back = trips(grid_combination(), slip=0.2)
    generator = np.random.default_rng(0)
    steps = [back.travel(cell(4, 4), cell(0, 0), generator) for _ in range(TRIPS)]
    assert abs(np.mean(steps) - 10) <= 4 * np.sqrt(2.5 / TRIPS)


def test_an_unfinished_scan_is_finished_before_it_moves() -> None:
    """While it scans only `measure` is possible, so that is what the way takes there, and never `end`."""
    program = graph_combination().program
    alone = replace(program, processes=program.moving, labels={}, rewards={})
    model = tabular(alone, explore(alone))
    loc, mode = model.valuations.T
    choice = return_policy(model, loc == 0)
    (scanning,) = np.flatnonzero((loc == 1) & (mode == 1))  # in A
    assert model.action_names[model.choice_action[choice[scanning]]] == "measure"
    assert "end" not in model.action_names


def test_where_no_way_leads_back_it_says_so() -> None:
    combination = graph_combination()
    forward = tuple(action for action in combination.capability.external if action.name == "jump")
    one_way = trips(with_capability(combination, external=forward))
    with pytest.raises(InputError, match="can't get back from B to its start S by its own moves"):
        one_way.travel(
            {"loc": 2, "mode": 0, "done": 1}, {"loc": 0, "mode": 0, "done": 0}, np.random.default_rng(0)
        )
