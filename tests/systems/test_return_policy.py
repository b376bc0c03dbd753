from __future__ import annotations

import numpy as np
import pytest

from merap.concerns.combination import Combination
from merap.errors import InputError
from merap.systems.return_policy import ReturnTrips, return_policy
from merap.systems.slip import slipping_pair
from tests.support.hand_made import cells, graph_combination, grid_combination, with_capability

TRIPS = 2000


def trips(combination: Combination, slip: float = 0.0) -> ReturnTrips:
    return ReturnTrips(combination, slipping_pair(combination, slip))


@pytest.mark.parametrize(
    ("start", "end", "distance"),
    [((0, 0), (0, 0), 0), ((4, 4), (0, 0), 8), ((0, 0), (0, 2), 6)],
)
def test_without_chance_it_is_the_shortest_path(
    start: tuple[int, int], end: tuple[int, int], distance: int
) -> None:
    """A wall at column 1 in rows 0 and 1 makes the way from (0,0) to (0,2) two down, two right, two up."""
    combination = grid_combination(blocked=cells((0, 1), (1, 1)))
    origin, target = 9 * start[0] + start[1], 9 * end[0] + end[1]
    assert trips(combination).travel(origin, target, np.random.default_rng(0)) == distance


def test_a_slip_makes_it_longer() -> None:
    """A step succeeds with 1 - p: 8 / 0.8 = 10 steps expected.

    The variance is that of a negative binomial, 8 * 0.2 / 0.8^2 = 2.5. Within 4
    standard errors; fails by luck with less than 1 in 10,000.
    """
    back = trips(grid_combination(), slip=0.2)
    generator = np.random.default_rng(0)
    steps = [back.travel(40, 0, generator) for _ in range(TRIPS)]
    assert abs(np.mean(steps) - 10) <= 4 * np.sqrt(2.5 / TRIPS)


def test_an_unfinished_scan_is_finished_before_it_moves() -> None:
    """While it scans only `measure` is possible, so that is what the way takes there, and never `end`."""
    combination = graph_combination()
    pair = slipping_pair(combination, 0.0)
    names = np.array(pair.action_names)
    scanning = 3 * 1 + 1  # in A
    way = return_policy(pair, 0)
    assert names[pair.choice_action[way.choice[scanning]]] == "measure"
    assert "end" not in names[pair.choice_action[way.choice[way.choice >= 0]]]


def test_where_no_way_leads_back_it_says_so() -> None:
    combination = graph_combination()
    forward = tuple(action for action in combination.capability.external if action.name == "jump")
    one_way = trips(with_capability(combination, external=forward))
    with pytest.raises(InputError, match="can't get back from B to its start S by its own moves"):
        one_way.travel(3 * 2, 0, np.random.default_rng(0))
