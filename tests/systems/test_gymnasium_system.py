from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from merap.errors import InputError
from merap.mdp.gymnasium_env import MDPEnv
from merap.mdp.gymnasium_import import import_gymnasium
from merap.mdp.index import index_of
from merap.mdp.planning import backward_induction
from merap.systems.gymnasium import GymnasiumSystem
from merap.systems.interface import SystemFault
from merap.systems.served import ServedSystem
from merap.systems.strategy import StateIndex
from tests.support.grid_tasks import grid_model, grid_task

IDS = ["FrozenLake-v1", "CliffWalking-v1", "Taxi-v4"]


class Own(gymnasium.Env[Any, Any]):
    """Counts up to 3; its observation has the keys of its space in another order."""

    def __init__(self, observation_space: gymnasium.Space[Any], mask: list[int] | None = None) -> None:
        self.observation_space = observation_space
        self.action_space = spaces.Discrete(2, start=5)
        self.mask = mask
        self.count = 0
        self.taken: list[int] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.count = 0
        return self._seen(), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.taken.append(int(action))
        self.count += 1
        return self._seen(), 0.5, False, self.count == 3, self._info()

    def _seen(self) -> Any:
        return {"time": self.count, "place": np.array([1, 2]), "lamps": (np.array([1, 0], dtype=np.int8), 7)}

    def _info(self) -> dict[str, Any]:
        return {} if self.mask is None else {"action_mask": np.array(self.mask, dtype=np.int8)}


NESTED = spaces.Dict(
    {
        "place": spaces.MultiDiscrete([3, 4]),
        "time": spaces.Discrete(4),
        "lamps": spaces.Tuple((spaces.MultiBinary(2), spaces.Box(5, 9, (), np.int64))),
    }
)


@pytest.mark.parametrize("env_id", IDS)
def test_what_is_seen_of_a_tabular_environment_is_possible_in_its_model(env_id: str) -> None:
    """Random steps: every successor, reward and end that is seen is a branch of `import_gymnasium`."""
    mdp = import_gymnasium(env_id)
    generator = np.random.default_rng(0)
    index = StateIndex(index_of(mdp))
    with GymnasiumSystem(env_id, seed=3, masked=False) as system:
        assert system.actions == mdp.action_names[:-1]
        found = system.reset()
        state = index(found)
        assert mdp.initial[state] > 0
        for _ in range(150):
            action = int(generator.integers(len(system.actions)))
            found = system.step(action)
            choice = np.flatnonzero((mdp.choice_state == state) & (mdp.choice_action == action))[0]
            branches = range(mdp.choice_to_branch[choice], mdp.choice_to_branch[choice + 1])
            target = index(found)
            seen = [branch for branch in branches if mdp.branch_target[branch] == target]
            assert len(seen) == 1
            assert mdp.branch_reward is not None
            assert mdp.branch_reward[seen[0]] == pytest.approx(found.reward)
            state = index(system.reset()) if found.last else target


def test_the_best_policy_of_the_model_is_worth_the_same_in_the_environment() -> None:
    """FrozenLake without ice: six steps to the goal, which earns 1."""
    mdp = import_gymnasium("FrozenLake-v1", is_slippery=False)
    best, index = backward_induction(mdp, 6), StateIndex(index_of(mdp))
    with GymnasiumSystem("FrozenLake-v1", arguments={"is_slippery": False}) as system:
        found, earned = system.reset(), 0.0
        for time in range(6):
            found = system.step(int(best.actions[time, index(found)]))
            earned += found.reward
    assert (earned, found.continuation, found.truncated) == (1.0, 0.0, False)
    assert found.valuation.tolist() == [3, 3]
    assert not found.enabled.any()


def test_our_own_models_come_back_as_they_are() -> None:
    model = grid_model(grid_task((0, 2)))
    system = GymnasiumSystem(MDPEnv(model, horizon=3))
    assert system.actions == model.action_names[:-1]
    assert system.reset().valuation.tolist() == [0, 0]
    assert [system.step(4).valuation.tolist() for _ in range(2)] == [[0, 1], [0, 2]]
    found = system.step(0)
    assert (found.reward, found.continuation, found.truncated) == (10.0, 0.0, False)


def test_the_limit_of_steps_truncates() -> None:
    with GymnasiumSystem("CliffWalking-v1", arguments={"max_episode_steps": 2}) as system:
        system.reset()
        assert not system.step(0).last
        found = system.step(0)
        assert (found.continuation, found.truncated) == (1.0, True)
        with pytest.raises(InputError, match="the episode is over; reset"):
            system.step(0)
        assert not system.reset().last


def test_numbers_of_a_nested_observation_are_variables_in_the_order_of_the_space() -> None:
    system = GymnasiumSystem(Own(NESTED))
    variables = {one.name: (one.low, one.high) for one in system.interface.variables}
    # Gymnasium sorts the keys of a Dict; -1 is the value of a completed task
    assert variables == {
        "lamps_x0_x0": (0, 1),
        "lamps_x0_x1": (0, 1),
        "lamps_x1_x0": (5, 9),
        "place_x0": (0, 2),
        "place_x1": (0, 3),
        "time": (0, 3),
    }
    assert system.reset().valuation.tolist() == [1, 0, 7, 1, 2, 0]
    assert system.step(0).valuation.tolist() == [1, 0, 7, 1, 2, 1]


def test_actions_are_counted_from_the_space_s_first() -> None:
    env = Own(NESTED)
    system = GymnasiumSystem(env)
    system.reset()
    system.step(0)
    system.step(1)
    assert env.taken == [5, 6]


def test_an_action_mask_tells_what_is_enabled() -> None:
    system = GymnasiumSystem(Own(NESTED, mask=[0, 1]))
    assert system.reset().enabled.tolist() == [False, True]
    with pytest.raises(InputError, match="action 0 is not enabled; enabled are a1"):
        system.step(0)
    assert GymnasiumSystem(Own(NESTED, mask=[0, 1]), masked=False).reset().enabled.tolist() == [True, True]
    with pytest.raises(
        SystemFault, match=r"malformed: Own: reset: the action mask has shape \(3,\), not \(2,\)"
    ):
        GymnasiumSystem(Own(NESTED, mask=[0, 1, 1])).reset()


def test_the_seed_determines_the_episodes() -> None:
    def walk(seed: int) -> list[list[int]]:
        with GymnasiumSystem("FrozenLake-v1", seed=seed) as system:
            seen = []
            for _ in range(5):
                found = system.reset()
                while not found.last:
                    found = system.step(2)
                    seen.append(found.valuation.tolist())
        return seen

    assert walk(1) == walk(1)
    assert walk(1) != walk(2)


def test_an_environment_can_be_served() -> None:
    with GymnasiumSystem("FrozenLake-v1", seed=0, arguments={"is_slippery": False}) as system:
        served = ServedSystem(system, system.interface)
        served.execute({"action": "down"})
        assert served.monitor()["valuation"] == {"row": 1, "col": 0}


@pytest.mark.parametrize(
    ("env", "message"),
    [
        ("Nothing-v0", "Gymnasium can't make 'Nothing-v0'"),
        ("CartPole-v1", r"CartPole-v1: Box\(.*\) is no space of whole numbers; allowed: Discrete"),
        ("Pendulum-v1", r"Pendulum-v1: its actions are Box\(.*\); a managed system needs Discrete"),
    ],
)
def test_what_has_no_whole_numbers_is_refused(env: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        GymnasiumSystem(env)
