from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from merap.errors import InputError
from merap.mdp.evaluation import expected_return
from merap.mdp.gymnasium_env import TABULAR_ID, MDPEnv
from merap.mdp.gymnasium_spaces import ObservationKind
from merap.mdp.gymnasium_vector import MDPVectorEnv
from merap.mdp.model import Floats, Ints, TabularMDP
from tests.support.mdp_examples import State, grid_cells, make_mdp, random_mdp, whole_paper_grid
from tests.support.placed import placed

HORIZON = 7


def corridor(slip: float = 0.0) -> TabularMDP:
    """Cells 0 to 2 are states 1 to 3: no `left` in cell 0, `leave` in cell 2 alone, it ends the task."""
    ahead: dict[State, float] = {(2,): 1.0} if slip == 0 else {(2,): 1 - slip, (1,): slip}
    whole = make_mdp(
        {
            (0,): {"right": (-1.0, {(1,): 1.0})},
            (1,): {"left": (-2.0, {(0,): 1.0}), "right": (-1.0, ahead)},
            (2,): {"left": (-2.0, {(1,): 1.0}), "leave": (10.0, {(-1,): 1.0})},
            (-1,): {"end": (0.0, {(-1,): 1.0})},
        },
        variables=("cell",),
        actions=("left", "right", "leave", "end"),
        labels={"done": {(-1,)}},
    )
    return placed(whole, np.arange(3)[:, np.newaxis], ("cell",), ("left", "right", "leave"))


def legal(infos: dict[str, Any], rng: np.random.Generator) -> Ints:
    """A random enabled action of each environment; any where an episode has ended."""
    mask = infos["action_mask"]
    return np.asarray(np.argmax(mask * rng.random(mask.shape), axis=1))


def assert_equal(one: Any, other: Any) -> None:
    """Equal values, shapes and types, in dictionaries and arrays of objects too."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_equal(one[key], other[key])
        return
    assert one.dtype == other.dtype
    if one.dtype == object:
        assert [type(entry) for entry in one] == [type(entry) for entry in other]
    assert [np.array(entry).tolist() for entry in one] == [np.array(entry).tolist() for entry in other]


def assert_same_run(ours: MDPVectorEnv, theirs: SyncVectorEnv, steps: int) -> None:
    """Both give the same in every step, whatever they return; and episodes end in between."""
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    rng = np.random.default_rng(3)
    results: tuple[Any, Any] = ours.reset(seed=5), theirs.reset(seed=5)
    ends = 0
    for _ in range(steps):
        for one, other in zip(*results, strict=True):
            assert_equal(one, other)
        actions = legal(results[0][-1], rng)
        step = ours.step(actions)
        ends += int(step[2].sum() > 0) + int(step[3].sum() > 0)
        results = step, theirs.step(actions)
    assert ends > 2


MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


@pytest.mark.parametrize("observation", ["state", "factored", "box"])
@pytest.mark.parametrize("mode", MODES)
def test_without_chance_it_is_the_synchronous_vector_of_environments(
    mode: AutoresetMode, observation: ObservationKind
) -> None:
    mdp = corridor()
    ours = MDPVectorEnv(mdp, 5, HORIZON, observation=observation, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: MDPEnv(mdp, HORIZON, observation=observation)] * 5, autoreset_mode=mode)
    assert_same_run(ours, theirs, 60)


@pytest.mark.parametrize("mode", MODES)
def test_one_environment_draws_as_the_single_one_does(mode: AutoresetMode) -> None:
    mdp = random_mdp(np.random.default_rng(1))
    ours = MDPVectorEnv(mdp, 1, HORIZON, autoreset_mode=mode)
    assert_same_run(ours, SyncVectorEnv([lambda: MDPEnv(mdp, HORIZON)], autoreset_mode=mode), 200)


def test_ended_environments_are_reset_by_mask() -> None:
    mdp = corridor()
    ours = MDPVectorEnv(mdp, 3, 4, autoreset_mode=AutoresetMode.DISABLED)
    theirs = SyncVectorEnv([lambda: MDPEnv(mdp, 4)] * 3, autoreset_mode=AutoresetMode.DISABLED)
    right, left, leave = 1, 0, 2
    ours.reset(), theirs.reset()
    for actions in ([right] * 3, [right, left, right]):
        for one, other in zip(ours.step(actions), theirs.step(actions), strict=True):
            assert_equal(one, other)
    step = ours.step([leave, right, left])
    assert step[2].tolist() == [True, False, False]
    with pytest.raises(InputError, match="environment 0 has ended"):
        ours.step([right] * 3)
    theirs.step([leave, right, left])
    mask = np.array([True, False, False])
    for one, other in zip(
        ours.reset(options={"reset_mask": mask}), theirs.reset(options={"reset_mask": mask}), strict=True
    ):
        assert_equal(one, other)
    # The others are in their fourth step, the first in its first one.
    assert ours.step([right] * 3)[3].tolist() == [False, True, True]


def uniform_policy(mdp: TabularMDP) -> Floats:
    return np.asarray(mdp.enabled / np.maximum(mdp.enabled.sum(axis=1, keepdims=True), 1))


def returns(env: Any, episodes: int) -> Floats:
    """[B * episodes], returns of the first episodes of each environment under a uniform policy."""
    rng = np.random.default_rng(0)
    _, infos = env.reset(seed=1)
    number = np.zeros(env.num_envs, dtype=np.int64)
    total = np.zeros((env.num_envs, episodes + 1))  # the last column takes what is not counted
    for _ in range(episodes * (HORIZON + 1)):
        _, reward, terminated, truncated, infos = env.step(legal(infos, rng))
        total[np.arange(env.num_envs), number] += reward
        number = np.minimum(number + (terminated | truncated), episodes)
    assert np.all(number == episodes)
    return total[:, :-1].ravel()


def ours(mdp: TabularMDP) -> MDPVectorEnv:
    return MDPVectorEnv(mdp, 64, HORIZON)


def synchronous(mdp: TabularMDP) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: MDPEnv(mdp, HORIZON)] * 64)


@pytest.mark.parametrize("make", [ours, synchronous])
@pytest.mark.parametrize(
    "mdp", [corridor(0.3), random_mdp(np.random.default_rng(2))], ids=["corridor", "random"]
)
def test_returns_are_distributed_as_planned(mdp: TabularMDP, make: Callable[[TabularMDP], Any]) -> None:
    # Second route: the exact value of the policy.
    sample = returns(make(mdp), 16)
    error = sample.std() / np.sqrt(len(sample))
    assert abs(sample.mean() - expected_return(mdp, uniform_policy(mdp), HORIZON)) <= 4 * error


def grid(goal: tuple[int, int]) -> TabularMDP:
    moves = ("stop", "up", "down", "left", "right")
    return placed(whole_paper_grid(3, goal), grid_cells(3), ("row", "col"), moves)


def test_each_block_of_environments_has_its_model() -> None:
    goals = [(0, 1), (1, 0), (2, 2)]
    env = MDPVectorEnv([grid(goal) for goal in goals], 6, 18, observation="factored")
    env.reset(seed=0)
    stop, down, right = 0, 2, 4
    env.step([right] * 6)
    observed, reward, terminated, _, _ = env.step([stop] * 6)
    # The first two environments stand in their goal, the others in (0, 1) without one.
    assert reward.tolist() == [10, 10] + [-0.5] * 4
    assert terminated.tolist() == [True] * 2 + [False] * 4
    assert observed.tolist() == [[-2, -2]] * 2 + [[0, 1]] * 4
    env.reset(seed=0)
    env.step([down] * 6)
    assert env.step([stop] * 6)[1].tolist() == [-0.5, -0.5, 10, 10, -0.5, -0.5]


def test_gymnasium_makes_it() -> None:
    made = gymnasium.make_vec(TABULAR_ID, num_envs=4, mdp=corridor(), horizon=HORIZON)
    assert isinstance(made, MDPVectorEnv)
    assert made.num_envs == 4
    assert made.reset(seed=0)[0].tolist() == [1] * 4


def test_the_seed_determines_all() -> None:
    def run(seed: int) -> list[list[int]]:
        env = MDPVectorEnv(random_mdp(np.random.default_rng(1)), 8, HORIZON)
        rng = np.random.default_rng(0)
        _, infos = env.reset(seed=seed)
        observed = []
        for _ in range(30):
            step = env.step(legal(infos, rng))
            infos = step[-1]
            observed.append(step[0].tolist())
        return observed

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_what_is_returned_belongs_to_the_caller() -> None:
    env = MDPVectorEnv(corridor(), 2, HORIZON)
    env.reset(seed=0)
    for array in (*(step := env.step([1, 1]))[:4], *step[4].values()):
        array[:] = 0
    assert env.action_masks().tolist() == [[True, True, False]] * 2
    assert env.step([1, 1])[1].tolist() == [-1.0, -1.0]


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ([1, 0], r"environment 1: action left is not enabled in \(cell=0\)"),
        ([1, 3], "environment 1: there is no action 3, only 0 to 2"),
        ([-1, 1], "environment 0: there is no action -1"),
        ([1.0, 1.0], r"integers \[2\], not float64 \[2\]"),
        ([1], r"integers \[2\], not int64 \[1\]"),
    ],
)
def test_wrong_actions_are_refused(actions: list[int], message: str) -> None:
    env = MDPVectorEnv(corridor(), 2)
    env.reset(seed=0)
    with pytest.raises(InputError, match=message):
        env.step(actions)


def test_actions_are_ignored_where_an_episode_begins() -> None:
    env = MDPVectorEnv(corridor(), 2, 1)
    env.reset(seed=0)
    env.step([1, 1])
    observed, reward, terminated, truncated, _ = env.step([-9, 99])
    assert observed.tolist() == [1, 1]
    assert reward.tolist() == [0, 0]
    assert not (terminated | truncated).any()


def test_wrong_use_is_refused() -> None:
    with pytest.raises(InputError, match="5 environments can't be shared out among 2 models"):
        MDPVectorEnv([corridor(), corridor(0.1)], 5)
    with pytest.raises(InputError, match="horizon must be at least 1"):
        MDPVectorEnv(corridor(), 2, 0)
    with pytest.raises(InputError, match="no autoreset mode 'Never', only NextStep, SameStep, Disabled"):
        MDPVectorEnv(corridor(), 2, autoreset_mode="Never")
    env = MDPVectorEnv(corridor(), 2, autoreset_mode="SameStep")
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    with pytest.raises(InputError, match="call reset"):
        env.step([1, 1])
    with pytest.raises(InputError, match="call reset"):
        env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(InputError, match=r"reset_mask must be bool \[2\], it is int64 \[2\]"):
        env.reset(options={"reset_mask": np.array([1, 0])})


def test_wrappers_of_gymnasium_keep_the_score() -> None:
    """Every episode's return and length as summed up by hand, whatever ends it."""
    envs = RecordEpisodeStatistics(MDPVectorEnv(corridor(0.5), 6, HORIZON, autoreset_mode="SameStep"))
    _, infos = envs.reset(seed=0)
    rng = np.random.default_rng(1)
    returns, lengths, ended = np.zeros(6), np.zeros(6), 0
    for _ in range(40):
        _, reward, terminated, truncated, infos = envs.step(legal(infos, rng))
        returns, lengths = returns + reward, lengths + 1
        over = terminated | truncated
        if over.any():
            np.testing.assert_allclose(infos["episode"]["r"][over], returns[over])
            np.testing.assert_array_equal(infos["episode"]["l"][over], lengths[over])
        ended += int(over.sum())
        returns[over], lengths[over] = 0, 0
    assert ended > 20
