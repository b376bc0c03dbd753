from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from merap.errors import InputError
from merap.mdp.model import TabularMDP
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from tests.support.grid_tasks import ACTIONS, HORIZON, grid_model, grid_task
from tests.support.hand_made import graph_combination
from tests.support.placed import model_of

STOP, UP, DOWN, LEFT, RIGHT = range(5)
GOAL_NEAR = grid_model(grid_task((0, 2)))
SLIP = 0.3
SLIPPERY = grid_model(grid_task((8, 8)), slip=SLIP)
DRAWS = 4000


def system(model: TabularMDP, horizon: int = HORIZON, seed: int = 0) -> SimulatedSystem:
    return SimulatedSystem(model, horizon, np.random.default_rng(seed))


def trace(simulated: SimulatedSystem, actions: list[int]) -> list[tuple[list[int], float, float, bool]]:
    seen = [simulated.reset(), *(simulated.step(action) for action in actions)]
    return [(found.valuation.tolist(), found.reward, found.continuation, found.truncated) for found in seen]


def ring() -> TabularMDP:
    """Four locations and three modes; starts are 0 with 1/4 and 1 with 3/4."""
    return model_of(graph_combination())


def assert_share(count: int, probability: float, draws: int = DRAWS) -> None:
    """Within 4 standard deviations of a binomial."""
    deviation = math.sqrt(draws * probability * (1 - probability))
    assert abs(count - draws * probability) <= 4 * deviation


def test_an_episode_that_completes_the_task() -> None:
    assert trace(system(GOAL_NEAR), [RIGHT, RIGHT, STOP]) == [
        ([0, 0], 0, 1, False),
        ([0, 1], -0.5, 1, False),
        ([0, 2], -0.5, 1, False),
        ([-1, -1], 10, 0, False),
    ]


def test_passing_through_the_goal_completes_without_the_reward() -> None:
    # The paper: any action taken in the goal cell ends the task; only `stop` earns 10.
    assert trace(system(GOAL_NEAR), [RIGHT, RIGHT, LEFT])[-1] == ([-1, -1], -0.5, 0, False)


def test_the_horizon_truncates_and_does_not_complete() -> None:
    seen = trace(system(GOAL_NEAR, horizon=3), [STOP, UP, LEFT])
    assert [truncated for *_, truncated in seen] == [False, False, False, True]
    assert seen[-1] == ([0, 0], -0.5, 1, True)


def test_completing_with_the_last_step_is_no_truncation() -> None:
    assert trace(system(GOAL_NEAR, horizon=3), [RIGHT, RIGHT, STOP])[-1] == ([-1, -1], 10, 0, False)


@pytest.mark.parametrize(
    ("continuation", "truncated", "last"),
    [(1.0, False, False), (1.0, True, True), (0.0, False, True)],
)
def test_an_episode_is_over_when_completed_or_truncated(
    continuation: float, truncated: bool, last: bool
) -> None:
    found = Observation(np.zeros(2, np.int64), np.ones(5, np.bool_), 0.0, continuation, truncated)
    assert found.last is last
    assert found.detections == {}


@pytest.mark.parametrize("actions", [[RIGHT, RIGHT, STOP], [STOP] * HORIZON], ids=["completed", "truncated"])
def test_a_finished_episode_goes_on_only_after_a_reset(actions: list[int]) -> None:
    simulated = system(GOAL_NEAR)
    trace(simulated, actions)
    with pytest.raises(InputError, match="the episode is over; reset"):
        simulated.step(STOP)
    assert simulated.reset().valuation.tolist() == [0, 0]
    assert simulated.step(RIGHT).valuation.tolist() == [0, 1]


def test_a_system_begins_with_a_reset() -> None:
    with pytest.raises(InputError, match="reset"):
        system(GOAL_NEAR).step(STOP)


def test_actions_are_those_declared() -> None:
    assert system(GOAL_NEAR).actions == ACTIONS[:-1]  # `end` is none of them


@pytest.mark.parametrize("action", [-1, 5, 6, 1000])
def test_a_number_that_is_no_action_is_refused(action: int) -> None:
    simulated = system(GOAL_NEAR)
    simulated.reset()
    with pytest.raises(InputError, match=rf"action {action} is not enabled in state \(row=0, col=0\)"):
        simulated.step(action)


def test_a_disabled_action_is_refused_and_nothing_happens() -> None:
    simulated = system(ring())
    found = simulated.reset()
    names = simulated.actions
    assert names == ("stop", "go", "back", "jump", "measure", "start_scan")
    # `measure` is the automaton's, which idles at first
    assert not found.enabled[names.index("measure")]
    with pytest.raises(
        InputError, match=r"action 4 is not enabled in state .*; enabled are stop, go, .*start_scan"
    ):
        simulated.step(names.index("measure"))
    started = simulated.step(names.index("start_scan"))
    # scanning is no terminal mode: nothing but `measure` is possible
    assert started.valuation.tolist() == [found.valuation[0], 1]
    assert np.flatnonzero(started.enabled).tolist() == [names.index("measure")]


def test_in_the_completed_state_nothing_is_enabled() -> None:
    simulated = system(GOAL_NEAR)
    simulated.reset()
    simulated.step(RIGHT)
    simulated.step(RIGHT)
    assert not simulated.step(STOP).enabled.any()


def test_equal_seeds_give_equal_episodes() -> None:
    actions = [DOWN, RIGHT] * (HORIZON // 2)
    one, again, other = (trace(system(SLIPPERY, seed=seed), actions) for seed in (1, 1, 2))
    assert one == again
    assert one != other  # 18 slips of 0.3 each agree by luck with (0.7^2 + 0.3^2)^18 = 6e-5 at most


def test_successors_come_with_their_probabilities() -> None:
    simulated = system(SLIPPERY, horizon=1)
    stayed = 0
    for _ in range(DRAWS):
        simulated.reset()
        stayed += simulated.step(RIGHT).valuation.tolist() == [0, 0]
    assert_share(stayed, SLIP)


def test_episodes_begin_as_the_initial_distribution_says() -> None:
    simulated = system(ring())
    starts = [int(simulated.reset().valuation[0]) for _ in range(DRAWS)]
    assert set(starts) == {0, 1}
    assert_share(starts.count(0), 0.25)


def test_a_step_is_drawn_with_its_own_reward() -> None:
    """In A, `go` leads east to B with 0.9 (B is not icy, A not bright), else nowhere.

    A move to where it is lighter would earn light / 4; B is darker than A: -1 either way. `measure`
    earns 0.3 when it succeeds (0.9), else the rule for every other step: -1.
    """
    model = ring()
    simulated = system(replace(model, initial=np.eye(model.num_states)[np.flatnonzero(model.initial)[-1]]))
    names = simulated.actions
    moved = measured = 0
    for _ in range(DRAWS):
        assert simulated.reset().valuation.tolist() == [1, 0]
        found = simulated.step(names.index("go"))
        assert found.reward == -1
        assert found.valuation[0] in {1, 2}
        moved += found.valuation[0] == 2
        simulated.reset()
        simulated.step(names.index("start_scan"))
        found = simulated.step(names.index("measure"))
        succeeded = found.reward == pytest.approx(0.3)
        # scanned in A completes the task (ends_in)
        assert succeeded == (found.continuation == 0)
        assert succeeded or found.reward == -1
        measured += succeeded
    assert_share(moved, 0.9)
    assert_share(measured, 0.9)


def test_an_observation_cannot_change_the_model() -> None:
    found = system(GOAL_NEAR).reset()
    with pytest.raises(ValueError, match="read-only"):
        found.valuation[0] = 5


def test_a_snapshot_goes_on_as_if_nothing_had_happened() -> None:
    """Recorded as JSON in the middle of an episode; 36 later steps agree."""
    one, other = system(SLIPPERY, seed=3), system(SLIPPERY, seed=4)
    trace(one, [DOWN, RIGHT, DOWN])
    other.restore(json.loads(json.dumps(one.snapshot())))
    assert other.values == one.values
    rest = [RIGHT] * (HORIZON - 3)
    assert [one.step(a).valuation.tolist() for a in rest] == [other.step(a).valuation.tolist() for a in rest]
    assert trace(one, [DOWN] * HORIZON) == trace(other, [DOWN] * HORIZON)


@pytest.mark.parametrize(
    "snapshot", [{}, {"state": 0, "steps": "x", "generator": {}}, {"state": 0, "steps": 0}]
)
def test_what_is_no_snapshot_is_refused(snapshot: dict[str, object]) -> None:
    with pytest.raises(InputError, match="recorded state"):
        system(SLIPPERY).restore(snapshot)


def test_the_system_goes_on_under_another_model() -> None:
    """The cell to the right gets closed while the robot stands left of it: it stays where it is."""
    simulated = system(GOAL_NEAR)
    simulated.reset()
    closed = grid_model(grid_task((2, 0), closed=[(0, 1)]))
    assert simulated.fits(closed)
    simulated.switch(closed)
    assert simulated.step(RIGHT).valuation.tolist() == [0, 0]
    simulated.step(DOWN)
    simulated.step(DOWN)
    assert simulated.step(STOP).reward == 10


def test_the_system_can_not_go_on_where_it_would_be_in_a_wall() -> None:
    simulated = system(GOAL_NEAR)
    assert simulated.fits(grid_model(grid_task((2, 0), closed=[(0, 1)])))
    trace(simulated, [RIGHT])
    assert not simulated.fits(grid_model(grid_task((2, 0), closed=[(0, 1)])))
