"""Values of given policies: textbook tables, dense recursion, what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.evaluation import as_policy, choice_weights, expected_return, policy_values
from merap.mdp.model import Floats
from tests.support.mdp_examples import corner_grid, jump_grid, make_mdp, puterman_two_states, random_mdp
from tests.support.mdp_routes import dense, random_policy

# Sutton and Barto 2018, Figure 4.1: the equiprobable policy after 10 sweeps and in the limit.
CORNER_GRID_10 = [
    [0, -6.1, -8.4, -9.0],
    [-6.1, -7.7, -8.4, -8.4],
    [-8.4, -8.4, -7.7, -6.1],
    [-9.0, -8.4, -6.1, 0],
]
CORNER_GRID_LIMIT = [[0, -14, -20, -22], [-14, -18, -20, -20], [-20, -20, -18, -14], [-22, -20, -14, 0]]
# Figure 3.2: the equiprobable policy on Example 3.5 at discount 0.9.
JUMP_GRID = [
    [3.3, 8.8, 4.4, 5.3, 1.5],
    [1.5, 3.0, 2.3, 1.9, 0.5],
    [0.1, 0.7, 0.7, 0.4, -0.4],
    [-1.0, -0.4, -0.4, -0.6, -1.2],
    [-1.9, -1.3, -1.2, -1.4, -2.0],
]


def test_the_equiprobable_policy_on_the_corner_grid() -> None:
    mdp = corner_grid()
    policy = np.full((16, 4), 0.25)
    assert np.abs(policy_values(mdp, policy, 10)[0].reshape(4, 4) - CORNER_GRID_10).max() <= 0.05
    np.testing.assert_allclose(policy_values(mdp, policy, 600)[0].reshape(4, 4), CORNER_GRID_LIMIT, atol=1e-9)


def test_the_equiprobable_policy_on_the_jump_grid() -> None:
    values = policy_values(jump_grid(), np.full((25, 4), 0.25), 300, 0.9)[0]
    assert np.abs(values.reshape(5, 5) - JUMP_GRID).max() <= 0.05


@pytest.mark.parametrize("seed", range(10))
def test_a_time_indexed_policy_against_dense_arrays(seed: int) -> None:
    generator = np.random.default_rng(seed)
    mdp = random_mdp(generator)
    policy = np.stack([random_policy(generator, mdp) for _ in range(5)])
    transition, reward = dense(mdp)
    expected = np.zeros((6, mdp.num_states))
    for t in reversed(range(5)):
        worth = reward + 0.8 * transition @ expected[t + 1]
        expected[t] = (policy[t] * worth).sum(axis=1)
    np.testing.assert_allclose(policy_values(mdp, policy, 5, 0.8), expected, atol=1e-12)
    assert expected_return(mdp, policy, 5, 0.8) == pytest.approx(expected[0, 0], abs=1e-12)


def test_a_stationary_policy_is_the_same_at_every_time() -> None:
    generator = np.random.default_rng(1)
    mdp = random_mdp(generator)
    policy = random_policy(generator, mdp)
    repeated = np.broadcast_to(policy, (4, *policy.shape))
    np.testing.assert_array_equal(policy_values(mdp, policy, 4), policy_values(mdp, repeated, 4))


def test_single_precision_is_normalised_away() -> None:
    mdp = puterman_two_states()
    third = np.float32(1) / np.float32(3)
    weights = choice_weights(mdp, np.array([[third, 2 * third, 0], [0, 0, 1]], dtype=np.float32))
    assert weights.dtype == np.float64
    assert weights.tolist() == [1 / 3, 2 / 3, 1]


def test_rows_of_unreachable_states_are_free() -> None:
    mdp = make_mdp({(0,): {"stay": (2.0, {(0,): 1.0})}, (1,): {"stay": (7.0, {(1,): 1.0})}, (2,): {}})
    values = policy_values(mdp, np.array([[1.0], [0.0], [0.0]]), 3)
    assert values[0].tolist() == [6, 0, 0]


def test_deterministic_actions_as_a_policy() -> None:
    policy = as_policy(puterman_two_states(), np.array([[1, 2], [-1, 2]]))
    assert policy.tolist() == [[[0, 1, 0], [0, 0, 1]], [[0, 0, 0], [0, 0, 1]]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda policy: policy[:1], r"the policy has shape \(1, 3\), not \(2, 3\)"),
        (lambda policy: policy * 0.9, r"\(s=1\): the policy gives 0.9 to the enabled actions, not 1"),
        (lambda policy: policy[:, ::-1], r"\(s=1\): the policy gives 0.5 to the enabled actions"),
        (lambda policy: policy - 1, r"\(s=1\), action a11: the policy has probability -0.5"),
        (lambda policy: policy * np.nan, r"\(s=1\), action a11: the policy has probability nan"),
        (lambda policy: np.stack([policy] * 3), r"the policy has 3 steps, the horizon is 2"),
    ],
)
def test_what_is_no_policy_is_refused(change: Callable[[Floats], Floats], message: str) -> None:
    policy = np.array([[0.5, 0.5, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(ModelError, match=message):
        policy_values(puterman_two_states(), change(policy), 2)
