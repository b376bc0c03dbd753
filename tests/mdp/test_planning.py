"""Optimal values: closed forms, textbook tables, dense dynamic programming."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.errors import EngineError
from merap.mdp.evaluation import as_policy, expected_return
from merap.mdp.planning import (
    backward_induction,
    choice_values,
    initial_value,
    optimum,
    value_iteration,
    worst_value,
)
from tests.support.mdp_examples import (
    State,
    corner_grid,
    jump_grid,
    large_grid,
    make_mdp,
    puterman_two_states,
    random_mdp,
    whole_paper_grid,
)
from tests.support.mdp_routes import dense

# Sutton and Barto 2018, Figure 3.5: optimal values of Example 3.5 at discount 0.9, one decimal.
JUMP_GRID_OPTIMUM = [
    [22.0, 24.4, 22.0, 19.4, 17.5],
    [19.8, 22.0, 19.8, 17.8, 16.0],
    [17.8, 19.8, 17.8, 16.0, 14.4],
    [16.0, 17.8, 16.0, 14.4, 13.0],
    [14.4, 16.0, 14.4, 13.0, 11.7],
]


@pytest.mark.parametrize(
    ("goal", "blocked", "expected"),
    [
        # 10 - 0.5 d with d the length of a shortest path; the optima of the paper's cases.
        ((4, 4), [], 6.0),
        ((2, 2), [], 8.0),
        ((4, 4), [(1, 2), (3, 2), (4, 1), (6, 1)], 6.0),
        ((0, 8), [(3, 2), (4, 2), (4, 3), (1, 3)], 6.0),
        ((0, 8), [(0, 3), (1, 5), (5, 3), (6, 3)], 5.0),
    ],
)
def test_the_papers_optima(goal: State, blocked: list[State], expected: float) -> None:
    mdp = whole_paper_grid(goal=goal, blocked=blocked)
    assert optimum(mdp, 18) == expected
    assert worst_value(mdp, 18) == -9.0  # 18 steps at 0.5 that never end


def test_the_optimum_needs_the_steps_it_needs() -> None:
    mdp = whole_paper_grid(goal=(4, 4))
    assert optimum(mdp, 9) == 6.0  # 8 moves and the stop
    assert optimum(mdp, 8) == -4.0
    assert optimum(mdp, 0) == 0.0


def test_discounting_by_closed_form() -> None:
    expected = 10 * 0.95**8 - 0.5 * sum(0.95**step for step in range(8))
    assert optimum(whole_paper_grid(goal=(4, 4)), 18, 0.95) == pytest.approx(expected, abs=1e-12)


def test_the_best_policy_depends_on_time() -> None:
    # By hand: saving pays 3 one step later, so it is worth it until the last step.
    mdp = make_mdp(
        {
            (0,): {"take": (1.0, {(0,): 1.0}), "save": (0.0, {(1,): 1.0})},
            (1,): {"cash": (3.0, {(0,): 1.0})},
        }
    )
    plan = backward_induction(mdp, 3)
    assert plan.values.tolist() == [[4, 6], [3, 4], [1, 3], [0, 0]]
    assert plan.actions.tolist() == [[0, 2], [1, 2], [0, 2]]
    assert plan.value == 4
    worst = backward_induction(mdp, 3, maximise=False)
    assert worst.values.tolist() == [[2, 4], [1, 3], [0, 3], [0, 0]]


def test_states_without_choices_are_worth_nothing_and_have_no_action() -> None:
    mdp = make_mdp({(0,): {"stay": (2.0, {(0,): 1.0})}, (1,): {}, (2,): {"go": (5.0, {(1,): 1.0})}})
    plan = backward_induction(mdp, 2)
    assert plan.values.tolist() == [[4, 0, 5], [2, 0, 5], [0, 0, 0]]
    assert plan.actions.tolist() == [[0, -1, 1], [0, -1, 1]]
    endless = value_iteration(mdp, 0.5)
    assert endless.values.tolist() == pytest.approx([4, 0, 5], abs=1e-8)
    assert endless.actions.tolist() == [0, -1, 1]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("maximise", [True, False])
def test_backward_induction_against_dense_arrays(seed: int, maximise: bool) -> None:
    mdp = random_mdp(np.random.default_rng(seed))
    transition, reward = dense(mdp)
    missing = -np.inf if maximise else np.inf
    expected = np.zeros(mdp.num_states)
    plan = backward_induction(mdp, 6, 0.9, maximise=maximise)
    for t in reversed(range(6)):
        worth = np.where(mdp.enabled, reward + 0.9 * transition @ expected, missing)
        expected = worth.max(axis=1) if maximise else worth.min(axis=1)
        np.testing.assert_allclose(plan.values[t], expected, atol=1e-12)
        assert np.take_along_axis(worth, plan.actions[t][:, None], axis=1)[:, 0] == pytest.approx(expected)
    assert expected_return(mdp, as_policy(mdp, plan.actions), 6, 0.9) == pytest.approx(plan.value, abs=1e-12)
    extreme = optimum(mdp, 6, 0.9) if maximise else worst_value(mdp, 6, 0.9)
    assert extreme == plan.value


def test_the_initial_distribution_weighs_values() -> None:
    mdp = replace(puterman_two_states(), initial=np.array([0.25, 0.75]))
    assert initial_value(mdp, np.array([8.0, 4.0])) == 5
    assert optimum(mdp, 1) == 0.25 * 10 - 0.75


def test_choice_values_of_the_two_state_example() -> None:
    # Puterman 2005, Section 3.1, by hand: 5 + 0.5 * (0.5 * 4 + 0.5 * 2) and so on.
    assert choice_values(puterman_two_states(), np.array([4.0, 2.0]), 0.5).tolist() == [6.5, 11, 0]


def test_value_iteration_on_the_two_state_example() -> None:
    # v(2) = -1 / (1 - 0.95) = -20; v(1) = 5 + 0.95 (v(1) - 20) / 2 = -60/7, better than 10 - 19.
    plan = value_iteration(puterman_two_states(), 0.95, precision=1e-9)
    assert plan.values.tolist() == pytest.approx([-60 / 7, -20], abs=1e-9)
    assert plan.actions.tolist() == [0, 2]
    assert plan.value == plan.values[0]
    worst = value_iteration(puterman_two_states(), 0.95, maximise=False)
    assert worst.values.tolist() == pytest.approx([-9, -20], abs=1e-9)
    assert worst.actions.tolist() == [1, 2]


def test_value_iteration_on_the_jump_grid() -> None:
    values = value_iteration(jump_grid(), 0.9).values.reshape(5, 5)
    assert np.abs(values - JUMP_GRID_OPTIMUM).max() <= 0.05
    # Closed form: from (0, 1) back to it takes five steps, 10 / (1 - 0.9^5).
    assert values[0, 1] == pytest.approx(10 / (1 - 0.9**5), abs=1e-9)


@pytest.mark.parametrize("precision", [1.0, 1e-3, 1e-9])
@pytest.mark.parametrize("seed", range(5))
def test_value_iteration_stays_within_its_error(seed: int, precision: float) -> None:
    mdp = random_mdp(np.random.default_rng(seed))
    plan = value_iteration(mdp, 0.9, precision)
    exact = value_iteration(mdp, 0.9, 1e-12)
    # The exact solution by a second route: solve the linear equations of the greedy policy.
    transition, reward = dense(mdp)
    states = np.arange(mdp.num_states)
    system = np.eye(mdp.num_states) - 0.9 * transition[states, exact.actions]
    solved = np.linalg.solve(system, reward[states, exact.actions])
    np.testing.assert_allclose(exact.values, solved, atol=1e-11)
    # The second route rounds as well.
    assert np.abs(plan.values - solved).max() <= plan.error + 1e-13
    assert plan.error <= precision


def test_value_iteration_refuses_what_it_cannot_do() -> None:
    with pytest.raises(ValueError, match="the discount must be in"):
        value_iteration(puterman_two_states(), 1.0)
    with pytest.raises(EngineError, match=r"value iteration is still up to .* off after 602 sweeps"):
        value_iteration(random_mdp(np.random.default_rng(0)), 0.9, precision=1e-30)


def test_undiscounted_distances_on_the_corner_grid() -> None:
    row, col = np.divmod(np.arange(16), 4)
    distance = np.minimum(row + col, 6 - row - col)
    plan = backward_induction(corner_grid(), 10)
    assert plan.values[0].tolist() == (-distance).tolist()


def test_a_large_model_is_planned() -> None:
    mdp = large_grid(450)
    # Next to the corner a step succeeds with 0.8: the truncated geometric sum of failures.
    expected = -sum(0.2**step for step in range(10))
    values = backward_induction(mdp, 10).values
    assert values[0, -2] == pytest.approx(expected, abs=1e-12)
    assert optimum(mdp, 10) == -10
