"""`eq:diff`: by hand, by dense arrays, and as a squared distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.difference import Difference, differences, model_difference, nearest
from merap.mdp.model import TabularMDP
from tests.support.mdp_examples import State, grid_cells, make_mdp, random_mdp, whole_paper_grid
from tests.support.mdp_routes import dense
from tests.support.placed import placed

ACTIONS = ("stop", "up", "down", "left", "right")


def two_states(reach: float, reward: float, *, rest: bool = True) -> TabularMDP:
    row: dict[str, tuple[float, dict[State, float]]] = {"go": (reward, {(0,): 1 - reach, (1,): reach})}
    if rest:
        row["rest"] = (1.0, {(0,): 1.0})
    return make_mdp({(0,): row, (1,): {"rest": (0.0, {(1,): 1.0})}}, actions=("go", "rest"))


def grid(goal: State = (4, 4), blocked: tuple[State, ...] = ()) -> TabularMDP:
    return placed(whole_paper_grid(goal=goal, blocked=blocked), grid_cells(), ("row", "col"), ACTIONS)


def test_by_hand() -> None:
    # T differs by 0.25 twice; r by 2 once.
    result = model_difference(two_states(0.5, 3.0), two_states(0.75, 1.0), w1=8.0, w2=0.5)
    assert result == Difference(total=3.0, transition=0.125, reward=4.0, per_branch=False)


def test_a_missing_choice_counts_as_zero() -> None:
    # rest is missing in one: T = 1 and r = 1 against 0.
    result = model_difference(two_states(0.5, 3.0, rest=False), two_states(0.5, 3.0))
    assert result == Difference(total=2.0, transition=1.0, reward=1.0, per_branch=False)


def test_rewards_per_branch_where_both_have_them() -> None:
    one = replace(two_states(0.5, 3.0), branch_reward=np.array([2.0, 4.0, 1.0, 0.0]))
    two = replace(two_states(0.75, 3.0), branch_reward=np.array([0.0, 4.0, 1.0, 0.0]))
    assert model_difference(one, two) == Difference(
        total=4.125, transition=0.125, reward=4.0, per_branch=True
    )
    assert model_difference(one, replace(two, branch_reward=None)).reward == 0
    assert not model_difference(replace(one, branch_reward=None), two).per_branch


def test_one_kind_of_reward_in_one_ranking() -> None:
    one = replace(two_states(0.5, 3.0), branch_reward=np.array([2.0, 4.0, 1.0, 0.0]))
    models = {"same": one, "expected": replace(one, branch_reward=None)}
    assert [entry.per_branch for entry in differences(one, models).values()] == [False, False]
    assert nearest(one, models) == ("same", Difference(0.0, 0.0, 0.0, per_branch=False))


@pytest.mark.parametrize("seed", range(10))
def test_against_dense_arrays(seed: int) -> None:
    generator = np.random.default_rng(seed)
    one, two = random_mdp(generator), random_mdp(generator)
    (transition_1, reward_1), (transition_2, reward_2) = dense(one), dense(two)
    result = model_difference(one, two, w1=0.5, w2=3.0)
    assert result.transition == pytest.approx(((transition_1 - transition_2) ** 2).sum(), rel=1e-12)
    assert result.reward == pytest.approx(((reward_1 - reward_2) ** 2).sum(), rel=1e-12)
    assert result.total == pytest.approx(0.5 * result.transition + 3 * result.reward, rel=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_it_is_a_squared_distance(seed: int) -> None:
    generator = np.random.default_rng(seed)
    one, two, three = (random_mdp(generator) for _ in range(3))
    assert model_difference(one, one).total == 0
    assert model_difference(one, two).total == pytest.approx(model_difference(two, one).total)
    sides = [model_difference(*pair).total ** 0.5 for pair in ((one, three), (one, two), (two, three))]
    assert sides[0] <= sides[1] + sides[2] + 1e-12


def test_goals_of_the_paper_grid() -> None:
    # In either goal cell `stop` pays 10 instead of -0.5 (10.5^2 twice) and all five actions
    # lead to the end instead of elsewhere (2 for each of 5 actions of 2 cells).
    result = model_difference(grid(goal=(4, 4)), grid(goal=(2, 2)))
    assert result.transition == 2 * 5 * 2
    assert result.reward == 2 * 10.5**2


def test_the_nearest_goal_and_the_nearest_obstacle() -> None:
    system = grid(blocked=((3, 3),))
    models = {"no_obstacle": grid(), "other_goal": grid(goal=(3, 4)), "both": grid((3, 4), ((5, 5),))}
    name, difference = nearest(system, models)
    assert name == "no_obstacle"
    # Four cells beside the obstacle lose one move (2 each); its own five choices are missing.
    assert difference.transition == 4 * 2 + 5
    assert difference.reward == 5 * 0.25
    assert set(differences(system, models)) == set(models)


def test_models_on_different_indices_are_refused() -> None:
    one = two_states(0.5, 3.0)
    with pytest.raises(ModelError, match="action_names are go, rest and go, nap"):
        model_difference(one, replace(one, action_names=("go", "nap")))
    with pytest.raises(ModelError, match="variable_names are s and t"):
        model_difference(one, replace(one, variable_names=("t",)))
    with pytest.raises(ModelError, match="their states differ"):
        model_difference(one, replace(one, valuations=np.array([[0], [2]])))
