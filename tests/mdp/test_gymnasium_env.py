from __future__ import annotations

import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation

from merap.errors import InputError
from merap.mdp.evaluation import expected_return
from merap.mdp.gymnasium_env import TABULAR_ID, MDPEnv, register_mdp
from merap.mdp.gymnasium_spaces import ObservationKind
from merap.mdp.model import TabularMDP
from tests.support.mdp_examples import grid_cells, jump_grid, make_mdp, whole_paper_grid
from tests.support.placed import placed

MOVES = ("stop", "up", "down", "left", "right")


def paper_grid(slip: float = 0.0) -> TabularMDP:
    return placed(whole_paper_grid(slip=slip), grid_cells(), ("row", "col"), MOVES)


def corridor() -> TabularMDP:
    """Cells 0 to 2: `left` is disabled in cell 0, `leave` possible in cell 2 alone; it ends the task."""
    return make_mdp(
        {
            (0,): {"right": (-1.0, {(1,): 1.0})},
            (1,): {"left": (-1.0, {(0,): 1.0}), "right": (-1.0, {(2,): 0.5, (1,): 0.5})},
            (2,): {"left": (-1.0, {(1,): 1.0}), "leave": (10.0, {(3,): 1.0})},
            (3,): {"end": (0.0, {(3,): 1.0})},
        },
        variables=("cell",),
        labels={"done": {(3,)}, "exit": {(2,)}},
    )


@pytest.mark.parametrize("observation", ["state", "factored", "box"])
@pytest.mark.parametrize("mdp", [paper_grid(0.2), jump_grid()], ids=["grid", "endless"])
def test_gymnasium_finds_nothing_wrong(mdp: TabularMDP, observation: str) -> None:
    # Warnings are errors here, and the made environment also checks every step it takes.
    made = gymnasium.make(TABULAR_ID, mdp=mdp, horizon=18, observation=observation, render_mode="ansi")
    check_env(made.unwrapped)
    made.reset(seed=0)
    ended = False
    while not ended:
        observed, _, terminated, truncated, _ = made.step(made.action_space.sample())
        assert made.observation_space.contains(observed)
        ended = terminated or truncated


def test_the_id_may_name_the_module() -> None:
    made = gymnasium.make("merap.mdp.gymnasium_env:merap/Tabular-v0", mdp=corridor(), horizon=3)
    assert isinstance(made.unwrapped, MDPEnv)
    assert made.unwrapped.horizon == 3


def test_a_registered_model_is_made_by_its_id() -> None:
    env_id = register_mdp("TestGrid", paper_grid(), horizon=18)
    try:
        assert env_id == "merap/TestGrid-v0"
        made = gymnasium.make(env_id)
        assert isinstance(made.unwrapped, MDPEnv)
        assert made.unwrapped.horizon == 18
        check_env(made.unwrapped)
        assert gymnasium.make_vec(env_id, num_envs=3).num_envs == 3
        with pytest.raises(InputError, match="merap/TestGrid-v0 already"):
            register_mdp("TestGrid", paper_grid())
    finally:
        del gymnasium.registry[env_id]


def episode(env: MDPEnv, actions: list[str], seed: int = 0) -> list[tuple[Any, ...]]:
    env.reset(seed=seed)
    return [env.step(env.action_names.index(name))[:4] for name in actions]


def test_the_paper_episode() -> None:
    # The paper's world, Fig. 5(a): 8 moves to (4, 4) at -0.5 each, then stop earns 10.
    env = MDPEnv(paper_grid(), horizon=18)
    steps = episode(env, ["down", "right"] * 4 + ["stop"])
    assert [reward for _, reward, _, _ in steps] == [-0.5] * 8 + [10.0]
    assert [terminated for _, _, terminated, _ in steps] == [False] * 8 + [True]
    assert steps[-1][0] == 1  # completed at the goal; elsewhere it would be 0


def test_truncation_at_the_horizon_unless_terminated() -> None:
    env = MDPEnv(paper_grid(), horizon=9)
    assert [step[3] for step in episode(env, ["left"] * 9)] == [False] * 8 + [True]
    assert episode(env, ["down", "right"] * 4 + ["stop"])[-1][2:] == (True, False)


def test_without_a_horizon_episodes_go_on() -> None:
    assert not any(step[2] or step[3] for step in episode(MDPEnv(paper_grid()), ["left"] * 300))


def test_observations() -> None:
    grid = paper_grid()
    kinds: dict[ObservationKind, Any] = {
        "state": gymnasium.spaces.Discrete(83),
        "factored": gymnasium.spaces.MultiDiscrete([11, 11], start=[-2, -2]),
        "box": gymnasium.spaces.Box(-2, 8, (2,), np.float32),
    }
    expected = {"state": 3, "factored": [0, 1], "box": [0.0, 1.0]}
    for kind, space in kinds.items():
        env = MDPEnv(grid, observation=kind)
        assert env.observation_space == space
        env.reset()
        np.testing.assert_array_equal(env.step(4)[0], expected[kind])
    flat = FlattenObservation(MDPEnv(grid))
    assert flat.reset()[0].tolist() == [0, 0, 1] + [0] * 80  # one-hot, by Gymnasium's own means


def test_masks_tell_what_is_enabled() -> None:
    env = MDPEnv(corridor())
    assert env.action_names == ("right", "left", "leave")
    _, info = env.reset(seed=0)
    assert info["action_mask"].dtype == np.int8
    assert info["action_mask"].tolist() == [1, 0, 0]
    assert env.step(0)[4]["action_mask"].tolist() == [1, 1, 0]
    assert env.action_masks().tolist() == [True, True, False]


def test_an_action_that_is_not_enabled_is_refused() -> None:
    env = MDPEnv(corridor())
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"left is not enabled in \(cell=0\), only right"):
        env.step(1)
    assert env.step(0)[0] == 1  # nothing has happened


@pytest.mark.parametrize("action", [3, -1, 0.0, "right"])
def test_what_is_no_action_is_refused(action: Any) -> None:
    env = MDPEnv(corridor())
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"there is no action .*, only 0 to 2"):
        env.step(action)


def test_a_step_outside_an_episode_is_refused() -> None:
    env = MDPEnv(corridor(), horizon=1)
    with pytest.raises(InputError, match="call reset"):
        env.step(0)
    env.reset()
    env.step(0)
    with pytest.raises(InputError, match="call reset"):
        env.step(0)


def test_the_seed_determines_episodes() -> None:
    def run(seed: int) -> list[tuple[Any, ...]]:
        return episode(MDPEnv(paper_grid(slip=0.5)), ["down", "right", "up"] * 20, seed)

    assert run(7) == run(7)
    assert run(7) != run(8)


def test_the_mean_return_is_the_expected_one() -> None:
    mdp = corridor()
    # In cell 1 right, in cell 2 leave: both by the first enabled action that does not go left.
    plan = {0: 0, 1: 0, 2: 2}
    policy = np.zeros((4, 4))
    policy[[0, 1, 2, 3], [*plan.values(), mdp.action_names.index("end")]] = 1.0
    env = MDPEnv(mdp, horizon=4)
    env.reset(seed=0)
    returns = []
    for _ in range(2000):
        state, total, ended = int(env.reset()[0]), 0.0, False
        while not ended:
            observed, reward, terminated, truncated, _ = env.step(plan[state])
            state, total, ended = int(observed), total + reward, terminated or truncated
        returns.append(total)
    error = np.std(returns) / np.sqrt(len(returns))
    assert abs(np.mean(returns) - expected_return(mdp, policy, 4)) <= 4 * error


def test_rendering() -> None:
    env = MDPEnv(corridor(), render_mode="ansi")
    env.reset(seed=0)
    assert env.render() == "step 0: (cell=0)"
    env.step(0)
    assert env.render() == "step 1: (cell=1), after right, reward -1"
    with pytest.raises(InputError, match="render_mode='ansi'"):
        MDPEnv(corridor()).render()


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(InputError, match="horizon must be at least 1 step, it is 0"):
        MDPEnv(corridor(), horizon=0)
    with pytest.raises(InputError, match="no observation 'pixels', only state, factored, box"):
        gymnasium.make(TABULAR_ID, mdp=corridor(), observation="pixels")
    with pytest.raises(InputError, match="no render mode 'human'"):
        MDPEnv(corridor(), render_mode="human")


WITHOUT = """
import pkgutil, sys
sys.modules["gymnasium"] = None
from importlib import import_module
import merap.mdp
from merap.errors import MerapError
for module in pkgutil.iter_modules(merap.mdp.__path__, "merap.mdp."):
    try:
        import_module(module.name)
    except MerapError as error:
        print(module.name, error, sep=": ")
"""


def test_gymnasium_is_needed_only_here_and_its_absence_is_one_line() -> None:
    run = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=True)
    lines = dict(line.split(": ", 1) for line in run.stdout.splitlines())
    names = {f"merap.mdp.gymnasium_{name}" for name in ("env", "import", "spaces", "toy_text", "vector")}
    assert lines.keys() == names
    assert set(lines.values()) == {"this needs Gymnasium, which is missing: pip install 'merap[gymnasium]'"}
