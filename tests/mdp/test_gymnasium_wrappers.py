"""Wrappers: names and tables of the environment inside are used only where nothing can have changed them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces, wrappers
from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv

from merap.errors import InputError
from merap.mdp.gymnasium_env import MDPEnv
from merap.mdp.gymnasium_import import import_gymnasium
from merap.mdp.gymnasium_spaces import changing_wrapper
from merap.systems.gymnasium import GymnasiumSystem
from tests.support.grid_tasks import grid_model, grid_task
from tests.support.mdp_routes import assert_identical

Env = gymnasium.Env[Any, Any]
Wrap = Callable[[Env], Env]


def lake() -> Env:
    return gymnasium.make("FrozenLake-v1", is_slippery=False)


class Mirrored(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Counts the cells from the other end, in the same space."""

    def observation(self, observation: Any) -> Any:
        return 15 - observation


class Turned(gymnasium.ActionWrapper[Any, Any, Any]):
    """Gives the actions other numbers, in the same space."""

    def action(self, action: Any) -> Any:
        return 3 - action


class Hidden(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Counts the cells from the other end, and says nothing about it."""

    def reset(self, **arguments: Any) -> Any:
        seen, info = self.env.reset(**arguments)
        return 15 - seen, info

    def step(self, action: Any) -> Any:
        seen, *rest = self.env.step(action)
        return (15 - seen, *rest)


class OnlyReset(gymnasium.Wrapper[Any, Any, Any, Any]):
    def reset(self, **arguments: Any) -> Any:
        seen, info = self.env.reset(**arguments)
        return 15 - seen, info


class OtherSpace(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Announces another space than it observes."""

    def __init__(self, env: Env) -> None:
        super().__init__(env)
        self.observation_space = spaces.Discrete(17)


def from_1(env: Env) -> Env:
    return wrappers.TransformObservation(env, lambda seen: seen + 1, spaces.Discrete(16, start=1))


CHANGING: dict[str, Wrap] = {
    "TransformObservation, from 1": from_1,
    "TransformObservation, an equal space": lambda env: wrappers.TransformObservation(
        env, lambda seen: 15 - seen, spaces.Discrete(16)
    ),
    "TransformObservation, the same space": lambda env: wrappers.TransformObservation(
        env, lambda seen: 15 - seen, None
    ),
    "TransformAction, from 1": lambda env: wrappers.TransformAction(
        env, lambda action: action - 1, spaces.Discrete(4, start=1)
    ),
    "TransformAction, an equal space": lambda env: wrappers.TransformAction(
        env, lambda action: 3 - action, spaces.Discrete(4)
    ),
    "TransformAction, fewer": lambda env: wrappers.TransformAction(
        env, lambda action: action + 1, spaces.Discrete(2)
    ),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.5),
    "RepeatAction": lambda env: wrappers.RepeatAction(env, 2),
    "DelayObservation": lambda env: wrappers.DelayObservation(env, 1),
    "DtypeObservation": lambda env: wrappers.DtypeObservation(env, np.int32),
    "Mirrored": Mirrored,
    "Turned": Turned,
    "Hidden": Hidden,
    "OnlyReset": OnlyReset,
    "OtherSpace": OtherSpace,
}

HARMLESS: dict[str, Wrap] = {
    "none": lambda env: env,
    "unwrapped": lambda env: env.unwrapped,
    "TimeLimit": lambda env: wrappers.TimeLimit(env, 5),
    "OrderEnforcing": wrappers.OrderEnforcing,
    "PassiveEnvChecker": wrappers.PassiveEnvChecker,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "Autoreset": wrappers.Autoreset,
    "TransformReward": lambda env: wrappers.TransformReward(env, lambda reward: 7 * float(reward)),
    "ClipReward": lambda env: wrappers.ClipReward(env, 0, 0.5),
    "NormalizeReward": wrappers.NormalizeReward,
    "a class that only inherits": type("Mine", (gymnasium.Wrapper,), {}),
    "a reward of one's own": type("Scaled", (gymnasium.RewardWrapper,), {"reward": lambda _, paid: 2 * paid}),
}


def test_cells_counted_from_1_are_shown_so() -> None:
    with GymnasiumSystem(from_1(lake())) as system:
        assert [variable.name for variable in system.interface.variables] == ["state"]
        assert system.reset().valuation.tolist() == [1]
        assert system.step(2).valuation.tolist() == [2]


@pytest.mark.parametrize("name", CHANGING)
def test_a_system_shows_what_gymnasium_returns(name: str) -> None:
    """Beside a copy that is stepped through Gymnasium alone."""
    alone = CHANGING[name](lake())
    assert isinstance(alone.action_space, spaces.Discrete)
    seen, _ = alone.reset(seed=3)
    with GymnasiumSystem(CHANGING[name](lake()), seed=3) as system:
        assert len(system.interface.variables) == 1  # not row and col
        assert system.actions == tuple(f"a{number}" for number in range(alone.action_space.n))
        assert system.reset().valuation.tolist() == [seen]
        for action in (1, 0, 1, 1, 0):
            seen, _, terminated, *_ = alone.step(int(alone.action_space.start) + action)
            assert system.step(action).valuation.tolist() == [seen]
            if terminated:
                break


@pytest.mark.parametrize("name", CHANGING)
@pytest.mark.parametrize("outer", ["none", "TimeLimit", "TransformReward"])
def test_the_table_inside_is_not_the_model_of_what_is_outside(name: str, outer: str) -> None:
    env = HARMLESS[outer](CHANGING[name](lake()))
    wrapper = changing_wrapper(env)
    assert wrapper is not None
    assert wrapper == name.split(",", maxsplit=1)[0]
    with pytest.raises(InputError, match=rf"FrozenLake-v1: {wrapper} may change .*pass env\.unwrapped"):
        import_gymnasium(env)
    assert_identical(import_gymnasium(env.unwrapped), import_gymnasium(lake()))


@pytest.mark.parametrize("name", HARMLESS)
def test_wrappers_that_change_neither_states_nor_actions(name: str) -> None:
    env = HARMLESS[name](lake())
    assert changing_wrapper(env) is None
    assert_identical(import_gymnasium(env), import_gymnasium(lake()))
    with GymnasiumSystem(env) as system:
        assert [variable.name for variable in system.interface.variables] == ["row", "col"]
        assert system.actions == ("left", "down", "right", "up")
        assert system.reset().valuation.tolist() == [0, 0]
        assert system.step(1).valuation.tolist() == [1, 0]


@pytest.mark.parametrize("inner", ["TimeLimit", "RecordEpisodeStatistics"])
def test_one_changing_wrapper_among_harmless_ones_is_enough(inner: str) -> None:
    env = wrappers.TimeLimit(HARMLESS[inner](Mirrored(lake())), 5)
    assert changing_wrapper(env) == "Mirrored"
    assert [one.name for one in GymnasiumSystem(env).interface.variables] == ["state"]


def test_wrappers_around_our_own_models() -> None:
    model = grid_model(grid_task((0, 2)))
    plain = wrappers.TimeLimit(MDPEnv(model), 3)
    assert GymnasiumSystem(plain).actions == model.action_names[:-1]
    last = model.num_states - 1
    turned = wrappers.TransformObservation(MDPEnv(model), lambda seen: last - seen, None)
    system = GymnasiumSystem(turned)
    assert [one.name for one in system.interface.variables] == ["state"]
    assert system.reset().valuation.tolist() == [last - int(np.flatnonzero(model.initial)[0])]


class LakeFrom1(FrozenLakeEnv):
    """A subclass whose own spaces are others than those of FrozenLake."""

    def __init__(self) -> None:
        super().__init__(is_slippery=False)
        self.observation_space = spaces.Discrete(16, start=1)

    def reset(self, **arguments: Any) -> Any:
        seen, info = super().reset(**arguments)
        return int(seen) + 1, info


def test_an_environment_of_other_spaces_has_no_names_and_counts_as_its_space_does() -> None:
    model = import_gymnasium(LakeFrom1())
    assert model.variable_names == ("state",)
    assert model.valuations[:-1, 0].tolist() == list(range(1, 17))
    system = GymnasiumSystem(LakeFrom1())
    assert system.actions == model.action_names[:-1] == ("a0", "a1", "a2", "a3")
    assert system.reset().valuation.tolist() == model.valuations[model.initial > 0][0].tolist() == [1]


class FewerStates(FrozenLakeEnv):
    def __init__(self) -> None:
        super().__init__()
        self.observation_space = spaces.Discrete(15)


class FewerActions(FrozenLakeEnv):
    def __init__(self) -> None:
        super().__init__()
        self.action_space = spaces.Discrete(3)


def test_a_table_of_another_size_than_the_spaces_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"FewerStates: P has 16 states, the observation space is Discrete\(15"
    ):
        import_gymnasium(FewerStates())
    with pytest.raises(InputError, match="P has action 3, there are 3 action names"):
        import_gymnasium(FewerActions())


def test_only_an_environment_can_be_imported() -> None:
    with pytest.raises(InputError, match="only an environment or its id can be imported, not SyncVectorEnv"):
        import_gymnasium(gymnasium.make_vec("FrozenLake-v1", 2, vectorization_mode="sync"))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="not int"):
        import_gymnasium(3)  # type: ignore[arg-type]
