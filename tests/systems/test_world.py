"""A combination that is simulated: slip, noise, detectors, what a reset does, changes."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from tests.support.grid_tasks import HORIZON, grid_model, grid_task
from tests.support.hand_made import at, cells, graph_combination, grid_combination, with_objective

STOP, UP, DOWN, LEFT, RIGHT = range(5)
GOAL_NEAR = grid_model(grid_task((0, 2)))
SLIP = 0.3
DRAWS = 4000


def walk(simulated: SimulatedSystem, actions: list[int]) -> Observation:
    for action in actions:
        found = simulated.step(action)
    return found


def grid(horizon: int = HORIZON, seed: int = 0, **settings: Any) -> SimulatedSystem:
    combination = grid_combination(goal=(0, 2))
    return SimulatedSystem(combination, horizon, np.random.default_rng(seed), **settings)


def canonical_system() -> SimulatedSystem:
    return SimulatedSystem(GOAL_NEAR, HORIZON, np.random.default_rng(0))


def seen_along(simulated: SimulatedSystem, actions: list[int]) -> list[tuple[list[int], float, float, bool]]:
    seen = [simulated.reset(), *(simulated.step(action) for action in actions)]
    return [
        (found.valuation[:2].tolist(), found.reward, found.continuation, found.truncated) for found in seen
    ]


def test_a_combination_is_simulated_like_its_model() -> None:
    """Where a task has ended is known of a combination, not of its model."""
    for actions in ([RIGHT, RIGHT, STOP], [RIGHT, RIGHT, LEFT], [STOP, UP, LEFT]):
        seen, of_model = seen_along(grid(), actions), seen_along(canonical_system(), actions)
        assert [row[1:] for row in seen] == [row[1:] for row in of_model]
        assert seen[:-1] == of_model[:-1]
        assert seen[-1][0] == {STOP: [0, 2], LEFT: [0, 1]}[actions[-1]] if seen[-1][2] == 0 else [0, 0]


def test_rewards_of_a_combination_are_those_of_the_single_step() -> None:
    """Driving into the dark B costs 2, failing to do so 1: Storm's text has the mean alone."""
    case = load_declared_case("models/running-example")
    simulated = SimulatedSystem(case.combine(1, 0, 0), 400, np.random.default_rng(0))
    names, places = simulated.actions, case.space.location_index
    simulated.reset()
    place, earned = places["S"], set()
    while place != places["B"]:
        action = {"S": "east", "lobby": "north", "hall_nw": "east"}[case.space.locations[place]]
        found = simulated.step(names.index(action))
        place = int(found.valuation[0])
        earned.add((place == places["B"], found.reward))
    assert earned <= {(True, -2.0), (False, -1.0)}
    assert (True, -2.0) in earned


def test_slip_leaves_the_state_and_the_cost() -> None:
    simulated = grid(horizon=1, slip=SLIP)
    stayed = 0
    for _ in range(DRAWS):
        simulated.reset()
        found = simulated.step(RIGHT)
        assert found.reward == -0.5
        stayed += found.valuation.tolist() == [0, 0, 0]
    # 4 standard deviations of a binomial: fails by luck with less than 1 in 10,000
    assert abs(stayed - DRAWS * SLIP) <= 4 * math.sqrt(DRAWS * SLIP * (1 - SLIP))


def test_noise_on_rewards_is_gaussian() -> None:
    """Mean and variance within 4 standard errors; fails by luck with about 1 in 8,000."""
    simulated = grid(horizon=DRAWS, noise=0.2)
    assert simulated.reset().reward == 0
    rewards = np.array([simulated.step(STOP).reward for _ in range(DRAWS)]) + 0.5
    assert abs(rewards.mean()) <= 4 * 0.2 / math.sqrt(DRAWS)
    assert abs(rewards.var() - 0.04) <= 4 * 0.04 * math.sqrt(2 / DRAWS)


def test_detectors_are_read_after_every_reset_and_step() -> None:
    case = load_declared_case("models/running-example")
    simulated = SimulatedSystem(case.system("met"), 40, np.random.default_rng(0), detect=True)
    found = simulated.reset()
    assert list(found.detections) == ["lidar", "light_meter"]
    assert found.detections["lidar"].keys() == {"S", "lobby"}  # type: ignore[attr-defined]
    moved = simulated.step(simulated.actions.index("start_scan"))
    assert moved.detections["light_meter"].keys() == {"S"}  # type: ignore[attr-defined]


def test_without_a_reset_the_next_episode_begins_where_the_last_was_truncated() -> None:
    simulated = grid(horizon=2, reset="none")
    simulated.reset()
    walk(simulated, [DOWN, DOWN])
    found = simulated.reset()
    assert found.valuation.tolist() == [2, 0, 0]
    assert not found.last
    assert simulated.step(DOWN).valuation.tolist() == [3, 0, 0]


def test_without_a_reset_a_completed_task_is_followed_by_one_from_its_location() -> None:
    """The action that ends the task still moves: from the goal (0,2) down to (1,2)."""
    simulated = grid(reset="none")
    simulated.reset()
    assert walk(simulated, [RIGHT, RIGHT, DOWN]).continuation == 0
    assert simulated.reset().valuation.tolist() == [1, 2, 0]


def test_a_task_that_was_truncated_goes_on_in_its_mode() -> None:
    simulated = SimulatedSystem(graph_combination(), 1, np.random.default_rng(0), reset="none")
    simulated.reset()
    simulated.step(simulated.actions.index("start_scan"))
    found = simulated.reset()
    assert found.valuation[1] == 1
    assert np.flatnonzero(found.enabled).tolist() == [simulated.actions.index("measure")]


def test_a_new_task_begins_in_the_initial_mode() -> None:
    """Scanned in A completes the task; the next one begins there, idle."""
    combination = graph_combination()
    start = np.array([0.0, 1.0, 0.0, 0.0])
    simulated = SimulatedSystem(
        with_objective(combination, start=start), 100, np.random.default_rng(0), reset="none"
    )
    simulated.reset()
    found = simulated.step(simulated.actions.index("start_scan"))
    while not found.last:
        found = simulated.step(simulated.actions.index("measure"))
    assert simulated.reset().valuation.tolist() == [1, 0]


def test_a_place_where_every_task_is_complete_cannot_begin_one() -> None:
    at_goal = cells((0, 2))
    combination = with_objective(grid_combination(goal=(0, 2)), ends_after=None, ends_in=at(at_goal))
    simulated = SimulatedSystem(combination, HORIZON, np.random.default_rng(0), reset="none")
    simulated.reset()
    assert walk(simulated, [RIGHT, RIGHT]).continuation == 0
    with pytest.raises(InputError, match=r"no task can begin in state \(row=0, col=2, .*, where the last"):
        simulated.reset()


def test_the_way_back_to_the_start_is_counted() -> None:
    simulated = grid(horizon=3, reset="return_to_start")
    simulated.reset()
    assert simulated.steps_back == 0
    walk(simulated, [DOWN, DOWN, RIGHT])
    assert simulated.reset().valuation.tolist() == [0, 0, 0]
    assert simulated.steps_back == 3
    walk(simulated, [RIGHT, RIGHT, DOWN])  # completed, and ends in (1, 2)
    simulated.reset()
    assert simulated.steps_back == 6


def test_a_change_leaves_the_system_where_it_is() -> None:
    simulated = grid()
    simulated.reset()
    walk(simulated, [RIGHT, RIGHT])
    simulated.switch(grid_combination(blocked=cells((0, 3)), goal=(1, 2)))
    assert simulated.look().valuation.tolist() == [0, 2, 0]
    assert simulated.step(RIGHT).valuation.tolist() == [0, 2, 0]  # blocked now
    assert simulated.step(STOP).continuation == 1  # the goal has moved
    assert walk(simulated, [DOWN, STOP]).reward == 10


def test_a_change_that_would_close_its_location_does_not_fit() -> None:
    simulated = grid()
    wall, ban = grid_combination(blocked=cells((0, 1))), grid_combination(no_entry=cells((0, 1)))
    assert simulated.fits(wall)
    simulated.reset()
    assert simulated.fits(wall)
    simulated.step(RIGHT)
    assert not simulated.fits(wall)
    assert not simulated.fits(ban)


def test_a_change_that_would_complete_the_task_where_it_is_does_not_fit() -> None:
    simulated = grid()
    simulated.reset()
    walk(simulated, [DOWN])
    ending = with_objective(grid_combination(), ends_after=None, ends_in=at(cells((1, 0))))
    assert not simulated.fits(ending)
    walk(simulated, [DOWN])
    assert simulated.fits(ending)


def test_all_that_it_is_like_is_known_from_outside() -> None:
    assert grid().values is None
    simulated = grid()
    simulated.reset()
    walk(simulated, [DOWN, RIGHT])
    assert simulated.values == {"row": 1, "col": 1, "mode": 0, "done": 0}
    walk(simulated, [UP, RIGHT, STOP])
    assert simulated.values == {"row": 0, "col": 2, "mode": 0, "done": 1}


def test_a_snapshot_keeps_where_a_completed_task_has_ended() -> None:
    one, other = grid(reset="none"), grid(reset="none", seed=1)
    one.reset()
    walk(one, [RIGHT, RIGHT, DOWN])
    other.restore(json.loads(json.dumps(one.snapshot())))
    assert other.reset().valuation.tolist() == [1, 2, 0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"slip": 0.1}, "need a combination"),
        ({"detect": True}, "need a combination"),
        ({"reset": "none"}, "need a combination"),
        ({"reset": "never"}, "no reset mode 'never'; allowed: episodes, return_to_start, none"),
        ({"noise": -1.0}, "must be 0 or more, it is -1.0"),
        ({"noise": math.inf}, "must be 0 or more, it is inf"),
    ],
)
def test_what_a_canonical_model_cannot_do_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SimulatedSystem(GOAL_NEAR, HORIZON, np.random.default_rng(0), **settings)


def test_a_model_alone_is_no_change_of_a_combination() -> None:
    with pytest.raises(InputError, match="from a combination under one"):
        canonical_system().switch(grid_combination())
    with pytest.raises(InputError, match="from a combination under one"):
        grid().switch(GOAL_NEAR)
