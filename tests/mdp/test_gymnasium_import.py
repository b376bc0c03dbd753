from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.toy_text.frozen_lake import generate_random_map
from gymnasium.wrappers import TransformReward

from merap.errors import InputError, ModelError
from merap.mdp.gymnasium_env import MDPEnv
from merap.mdp.gymnasium_import import import_gymnasium, import_table
from merap.mdp.index import FamilyIndex
from merap.mdp.model import Floats
from merap.mdp.planning import backward_induction, value_iteration
from tests.support.mdp_routes import assert_identical

ENVIRONMENTS: dict[str, tuple[str, dict[str, Any]]] = {
    "lake-4": ("FrozenLake-v1", {"map_name": "4x4"}),
    "lake-4-dry": ("FrozenLake-v1", {"map_name": "4x4", "is_slippery": False}),
    "lake-8": ("FrozenLake-v1", {"map_name": "8x8"}),
    "lake-8-dry": ("FrozenLake-v1", {"map_name": "8x8", "is_slippery": False}),
    "lake-sure": ("FrozenLake-v1", {"success_rate": 1.0, "reward_schedule": (10, -5, -1)}),
    "lake-own": ("FrozenLake-v1", {"desc": ["SFHF", "FFFS", "HFFG"], "reward_schedule": (3, -2, -0.1)}),
    "taxi": ("Taxi-v4", {}),
    "taxi-rain": ("Taxi-v4", {"is_rainy": True}),
    "cliff": ("CliffWalking-v1", {}),
    "cliff-slippery": ("CliffWalking-v1", {"is_slippery": True}),
}


@pytest.fixture(params=ENVIRONMENTS)
def environment(request: pytest.FixtureRequest) -> Any:
    env_id, kwargs = ENVIRONMENTS[request.param]
    return gymnasium.make(env_id, **kwargs).unwrapped


def sweep(table: Any, values: Floats, discount: float) -> Floats:
    """One sweep of value iteration on `P` as it is, by a plain loop.

    An entry flagged as terminated adds its reward and nothing after it.
    """
    after = (discount * values).tolist()
    best = [
        max(
            sum(prob * (reward + (0 if over else after[target])) for prob, target, reward, over in row)
            for row in table[state].values()
        )
        for state in range(len(table))
    ]
    return np.array(best)


@pytest.mark.parametrize("discount", [0.9, 0.99])
def test_optimal_discounted_values_are_those_of_the_table(environment: Any, discount: float) -> None:
    mdp = import_gymnasium(environment)
    reachable = mdp.reachable[:-1]
    values = value_iteration(mdp, discount, precision=1e-9).values[:-1]
    # Values are optimal exactly if a sweep keeps them (Puterman 2005, Theorem 6.2.5); one that
    # moves them by e puts them at most e / (1 - discount) off. No sweep leaves the reachable states.
    residual = sweep(environment.P, values, discount)[reachable] - values[reachable]
    assert np.abs(residual).max() <= 2e-9


def test_value_iteration_on_the_table_gets_there(environment: Any) -> None:
    mdp = import_gymnasium(environment)
    discount = 0.7
    expected = np.zeros(len(environment.P))
    for _ in range(80):  # rewards are below 100, so that 100 * 0.7^80 / 0.3 < 2e-10 remains
        expected = sweep(environment.P, expected, discount)
    values = value_iteration(mdp, discount, precision=1e-9).values
    reachable = mdp.reachable[:-1]
    np.testing.assert_allclose(values[:-1][reachable], expected[reachable], rtol=0, atol=2e-9)


def test_optimal_values_of_a_horizon_are_those_of_the_table(environment: Any) -> None:
    mdp = import_gymnasium(environment)
    horizon = 40
    expected = [np.zeros(len(environment.P))]
    for _ in range(horizon):
        expected.append(sweep(environment.P, expected[-1], 1.0))
    plan = backward_induction(mdp, horizon)
    reachable = mdp.reachable[:-1]
    for values, of_table in zip(plan.values[::-1, :-1], expected, strict=True):
        np.testing.assert_allclose(values[reachable], of_table[reachable], rtol=0, atol=1e-9)
    start = environment.initial_state_distrib
    assert plan.value == pytest.approx(float(start @ expected[-1]), abs=1e-9)


def test_every_branch_is_one_of_the_table(environment: Any) -> None:
    mdp = import_gymnasium(environment)
    merged: dict[tuple[int, int, int], list[float]] = {}
    for state in np.flatnonzero(mdp.reachable[:-1]).tolist():
        for action, row in environment.P[state].items():
            for prob, target, reward, over in row:
                key = (state, action, len(environment.P) if over else int(target))
                total = merged.setdefault(key, [0.0, 0.0])
                total[0] += prob
                total[1] += prob * reward
    end = (mdp.num_states - 1, mdp.num_actions - 1, mdp.num_states - 1)
    merged = {key: total for key, total in merged.items() if total[0] > 0} | {end: [1.0, 0.0]}
    assert mdp.branch_reward is not None
    choice = mdp.branch_choice
    keys = zip(mdp.choice_state[choice], mdp.choice_action[choice], mdp.branch_target, strict=True)
    ours = {
        (int(state), int(action), int(target)): (prob, prob * reward)
        for (state, action, target), prob, reward in zip(
            keys, mdp.branch_prob, mdp.branch_reward, strict=True
        )
    }
    assert ours.keys() == merged.keys()
    for key, total in merged.items():
        assert ours[key] == pytest.approx(total, abs=1e-12)


def test_it_is_on_an_index(environment: Any) -> None:
    mdp = import_gymnasium(environment)
    assert mdp.action_names[-1] == "end"
    assert np.flatnonzero(mdp.labels["done"]).tolist() == [mdp.num_states - 1]
    completed = {frozenset[str](): mdp.num_states - 1}
    index = FamilyIndex(mdp.variable_names, mdp.valuations, completed, mdp.action_names[:-1])
    again = index.place(mdp)
    for name in (
        "state_to_choice",
        "choice_to_branch",
        "branch_target",
        "choice_action",
        "reachable",
        "valuations",
    ):
        np.testing.assert_array_equal(getattr(again, name), getattr(mdp, name))
    np.testing.assert_allclose(again.branch_prob, mdp.branch_prob, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(again.initial, mdp.initial)


def test_a_base_of_random_lakes_has_one_index() -> None:
    models = [import_gymnasium("FrozenLake-v1", desc=generate_random_map(8, seed=seed)) for seed in range(4)]
    assert len({model.labels["hole"].tobytes() for model in models}) == 4
    for model in models[1:]:
        np.testing.assert_array_equal(model.valuations, models[0].valuations)
        assert model.action_names == models[0].action_names


def test_episodes_of_the_import_are_those_of_the_environment() -> None:
    original = gymnasium.make("CliffWalking-v1").unwrapped
    ours = MDPEnv(import_gymnasium(original))
    rng = np.random.default_rng(0)
    assert ours.reset(seed=0)[0] == original.reset(seed=0)[0]
    for _ in range(3000):
        action = int(rng.integers(4))
        observed, reward, terminated, _, _ = ours.step(action)
        expected, paid, ended, _, _ = original.step(action)
        assert (reward, terminated) == (paid, ended)
        assert terminated or observed == expected
        if terminated:
            ours.reset(), original.reset()


def test_wrappers_are_no_part_of_the_model() -> None:
    wrapped = TransformReward(gymnasium.make("FrozenLake-v1"), lambda reward: 7 * float(reward))
    assert_identical(import_gymnasium(wrapped), import_gymnasium("FrozenLake-v1"))


def dice() -> dict[int, dict[int, list[tuple[float, int, float, bool]]]]:
    """In state 0 stop for 1, or roll: stay for 1 or 3, or go on to state 1 (not flagged), the last turn."""
    return {
        0: {
            0: [(1.0, 1, 1.0, True)],
            1: [(0.25, 0, 1.0, False), (0.25, 0, 3.0, False), (0.5, 1, 0.0, False)],
        },
        1: {0: [(1.0, 1, 0.0, True)]},
    }


def test_any_table() -> None:
    mdp = import_table(dice(), [1.0, 0.0])
    assert mdp.variable_names == ("state",)
    assert mdp.action_names == ("a0", "a1", "end")
    assert mdp.valuations.tolist() == [[0], [1], [-1]]
    assert mdp.enabled.tolist() == [[True, True, False], [True, False, False], [False, False, True]]
    assert mdp.reachable.all()  # the unflagged branch leads to state 1 itself
    # Closed form: to roll is worth v = (1 + 3) / 4 + 0.5 * v / 2, more than to stop.
    assert value_iteration(mdp, 0.5).values == pytest.approx([4 / 3, 0.0, 0.0], abs=1e-9)
    branch = int(mdp.choice_to_branch[1])
    assert mdp.branch_reward is not None
    assert (mdp.branch_prob[branch], mdp.branch_reward[branch]) == (0.5, 2.0)
    as_lists = [[actions[action] for action in sorted(actions)] for actions in dice().values()]
    assert_identical(import_table(as_lists, [1.0, 0.0]), mdp)


class Dice(gymnasium.Env[int, int]):
    """An environment of somebody else."""

    def __init__(self) -> None:
        self.P = dice()
        self.initial_state_distrib = np.array([0.5, 0.5])


def test_an_unknown_environment_with_a_table() -> None:
    mdp = import_gymnasium(Dice())
    assert mdp.initial.tolist() == [0.5, 0.5, 0.0]
    assert mdp.action_names == ("a0", "a1", "end")


def test_an_environment_without_a_table_is_refused() -> None:
    with pytest.raises(InputError, match="CartPole-v1 has no P"):
        import_gymnasium("CartPole-v1")
    nowhere = Dice()
    del nowhere.initial_state_distrib
    with pytest.raises(InputError, match="Dice has no initial_state_distrib"):
        import_gymnasium(nowhere)


def test_an_environment_that_does_not_exist_is_refused() -> None:
    with pytest.raises(InputError, match=r"can't make 'Frozen-v1'.*Did you mean"):
        import_gymnasium("Frozen-v1")
    with pytest.raises(InputError, match="unexpected keyword argument 'size'"):
        import_gymnasium("FrozenLake-v1", size=3)
    with pytest.raises(InputError, match="size: arguments are for an id"):
        import_gymnasium(Dice(), size=3)


def changed(entry: Any) -> Any:
    return {**dice(), 1: {0: [entry]}}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "P is empty"),
        ({0: 3}, "must be state -> action -> list"),
        (changed(("likely", 1, 0.0, False)), "all numbers: could not convert string to float: 'likely'"),
        (changed((1.0, 1, 0.0)), r"P\[1\]\[0\] holds \(1.0, 1, 0.0\), not \(probability"),
        (changed((1.0, 2, 0.0, False)), r"P\[1\]\[0\] has 2: a next state is an integer from 0 to 1"),
        (changed((1.0, 0.5, 0.0, False)), r"P\[1\]\[0\] has 0.5: a next state"),
        (changed((-1.0, 1, 0.0, False)), r"P\[1\]\[0\] has -1: a probability is in \[0, 1\]"),
        (changed((np.nan, 1, 0.0, False)), r"P\[1\]\[0\] has nan: a probability"),
        ({0: dice()[0], 7: dice()[1]}, r"P\[7\]\[0\] has 7: a state is an integer from 0 to 1"),
        (
            {**dice(), 1: {-1: [(1.0, 1, 0.0, True)]}},
            r"P\[1\]\[-1\] has -1: an action is an integer from 0 on",
        ),
    ],
)
def test_a_table_of_another_form_is_refused(table: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        import_table(table, [1.0, 0.0])


def test_a_table_that_is_no_mdp_is_refused() -> None:
    with pytest.raises(ModelError, match=r"\(state=1\), action a0: probabilities sum to 0.5"):
        import_table(changed((0.5, 1, 0.0, False)), [1.0, 0.0])
    with pytest.raises(ModelError, match=r"state \(state=1\) has no action"):
        import_table({**dice(), 1: {}}, [1.0, 0.0])
    with pytest.raises(InputError, match=r"shape \(3,\), P has 2 states"):
        import_table(dice(), [1.0, 0.0, 0.0])
