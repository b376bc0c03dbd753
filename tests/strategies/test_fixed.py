from __future__ import annotations

import numpy as np

from merap.mdp.index import index_of
from merap.mdp.model import Floats
from merap.strategies.evaluation import evaluator
from merap.strategies.fixed import FixedStrategy, optimal_policy
from merap.systems.simulated import SimulatedSystem
from tests.support.grid_tasks import HORIZON, grid_model, grid_task

TASK = grid_task((2, 3), [(0, 1)])
MODEL = grid_model(TASK)


def played(policy: Floats, allowed_action: int | None = None) -> list[int]:
    """The actions of an episode."""
    strategy = FixedStrategy(policy, index_of(MODEL), np.random.default_rng(0), "because")
    system = SimulatedSystem(MODEL, HORIZON, np.random.default_rng(0))
    observation = system.reset()
    strategy.begin(observation)
    actions = []
    while not observation.last:
        allowed = observation.enabled
        if allowed_action is not None:
            allowed = np.arange(len(allowed)) == allowed_action
        actions.append(strategy.act(allowed))
        observation = system.step(actions[-1])
        strategy.observe(actions[-1], observation)
    strategy.update()
    np.testing.assert_array_equal(strategy.policy(), policy)
    assert strategy.explain() == ("because",)
    return actions


def test_the_optimal_policy_is_worth_what_breadth_first_search_says() -> None:
    policy = optimal_policy(MODEL, HORIZON)
    assert policy.shape == (HORIZON, MODEL.num_states, 5)
    assert evaluator(MODEL, HORIZON)(policy) == TASK.optimum
    # five steps around (0, 1), and `stop`
    assert len(played(policy)) == 6


def test_a_policy_by_time_is_played_by_time() -> None:
    policy = np.zeros((HORIZON, MODEL.num_states, 5))
    policy[::2, :, 2] = 1  # down
    policy[1::2, :, 1] = 1  # up
    assert played(policy) == [2, 1] * 9


def test_after_a_gap_it_goes_on_at_the_time_that_it_is() -> None:
    policy = np.zeros((HORIZON, MODEL.num_states, 5))
    policy[:5, :, 2] = 1  # down
    policy[5:, :, 1] = 1  # up
    strategy = FixedStrategy(policy, index_of(MODEL), np.random.default_rng(0), "because")
    first = SimulatedSystem(MODEL, HORIZON, np.random.default_rng(0)).reset()
    found = []
    for time in (0, 4, 5):
        strategy.begin(first, time, resumed=time > 0)
        found.append(strategy.act(first.enabled))
    assert found == [2, 2, 1]


def test_after_its_last_step_a_policy_stays_with_it() -> None:
    policy = np.zeros((2, MODEL.num_states, 5))
    policy[0, :, 2] = policy[1, :, 3] = 1
    assert played(policy) == [2] + [3] * 17


def test_a_policy_without_time_is_played_always_unless_it_may_not() -> None:
    policy = np.broadcast_to(np.eye(5)[1], (MODEL.num_states, 5))
    assert played(policy) == [1] * 18
    assert played(policy, allowed_action=3) == [3] * 18
