"""Exact returns and their derivatives: numpy, Storm, dense arrays, finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from merap.errors import InputError
from merap.learning.core.values import hessian_product, values
from merap.learning.exact import ExactProblem, Span, exact_problem, expected_return
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp import evaluation
from merap.mdp.chain import induced_chain, write_induced_chain
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import TabularMDP
from tests.support.grid_tasks import ACTIONS, DISCOUNT, HORIZON, SIZE, grid_model, grid_task
from tests.support.learning_examples import (
    RING_DISCOUNT,
    RING_HORIZON,
    grid_batch,
    grid_models,
    random_table,
    ring_batch,
    ring_models,
    seeded,
    with_end,
)
from tests.support.storm_runs import storm_values

WORLDS = [
    pytest.param(lambda: grid_models(0.0), HORIZON, DISCOUNT, id="deterministic"),
    pytest.param(lambda: grid_models(0.2), HORIZON, DISCOUNT, id="slipping"),
    pytest.param(ring_models, RING_HORIZON, RING_DISCOUNT, id="ring"),
]
BATCHES = [
    pytest.param(grid_batch, id="deterministic"),
    pytest.param(lambda: grid_batch(0.2), id="slipping"),
    pytest.param(ring_batch, id="ring"),
]


@pytest.mark.parametrize(("models", "horizon", "discount"), WORLDS)
@pytest.mark.parametrize("seed", range(3))
def test_returns_equal_those_of_the_numpy_recursion(
    models: Callable[[], list[TabularMDP]], horizon: int, discount: float, seed: int
) -> None:
    made = models()
    tasks = task_batch(made, horizon, discount, torch.float64)
    policy = random_table(tasks.enabled, seed)
    assert not tasks.enabled.all()
    for given, gamma in ((None, discount), (1.0, 1.0), (0.0, 0.0)):
        expected = [
            evaluation.expected_return(model, with_end(row, model), horizon, gamma)
            for model, row in zip(made, policy, strict=True)
        ]
        found = expected_return(policy, exact_problem(tasks, given))
        np.testing.assert_allclose(found.numpy(), expected, rtol=1e-12)


@pytest.mark.parametrize(("models", "horizon", "discount"), WORLDS)
def test_storm_values_the_induced_chain_the_same(
    models: Callable[[], list[TabularMDP]], horizon: int, discount: float, tmp_path: Path
) -> None:
    made = models()
    tasks = task_batch(made, horizon, discount, torch.float64)
    policy = random_table(tasks.enabled, 5)
    found = expected_return(policy, exact_problem(tasks, discount=1.0))
    for n, model in enumerate(made):
        path, acting = tmp_path / f"{n}.umb", with_end(policy[n], model)
        write_induced_chain(model, acting, path)
        initial = restrict_to_reachable(induced_chain(model, acting)).initial
        values = np.array(storm_values(path, f'R{{"objective"}}=? [C<={horizon}]'))
        assert found[n].item() == pytest.approx(initial @ values, abs=1e-6)


@pytest.mark.parametrize(("goal", "optimum"), [((4, 4), 6.0), ((2, 2), 8.0), ((0, 8), 6.0)])
def test_down_then_right_then_stop_earns_the_papers_optimum(goal: tuple[int, int], optimum: float) -> None:
    # 10 - 0.5 d, d the steps to the goal: the paper's README
    tasks = task_batch([grid_model(grid_task(goal))], HORIZON, DISCOUNT)
    rows, columns = np.divmod(np.arange(tasks.num_states), SIZE)
    way = np.where(rows < goal[0], ACTIONS.index("down"), ACTIONS.index("right"))
    action = np.where((rows == goal[0]) & (columns == goal[1]), ACTIONS.index("stop"), way)
    policy = torch.nn.functional.one_hot(torch.from_numpy(action), tasks.num_actions) * tasks.enabled
    steps = sum(goal)
    assert expected_return(policy.float(), exact_problem(tasks, 1.0)).tolist() == [optimum]
    # geometric series of -0.5 over the way, then the prize
    discounted = -0.5 * (1 - DISCOUNT**steps) / (1 - DISCOUNT) + 10 * DISCOUNT**steps
    found = expected_return(policy.float(), exact_problem(tasks)).item()
    assert found == pytest.approx(discounted, rel=1e-5)


def policy_gradient(policy: Tensor, problem: ExactProblem) -> Tensor:
    """dJ/dpi [N, S, A]."""
    leaf = policy.detach().clone().requires_grad_()
    (gradient,) = torch.autograd.grad(expected_return(leaf, problem).sum(), leaf)
    return gradient


def hessian_times(policy: Tensor, direction: Tensor, problem: ExactProblem) -> Tensor:
    """The Hessian of J times a direction [N, S, A]."""
    table = policy.detach().numpy()
    found = values(table, problem.tasks, problem.horizon)
    return torch.from_numpy(hessian_product(table, found, direction.numpy(), problem.tasks))


SPANS: list[Span] = ["horizon", "infinite"]


def _central(function: Callable[[Tensor], Tensor], at: Tensor, direction: Tensor) -> Tensor:
    step = 1e-5
    return (function(at + step * direction) - function(at - step * direction)) / (2 * step)


def _relative_error(found: Tensor, expected: Tensor) -> float:
    return float((found - expected).norm() / expected.norm())


@pytest.mark.parametrize("span", SPANS)
@pytest.mark.parametrize("tasks", BATCHES)
def test_the_gradient_is_the_slope_of_the_return(tasks: Callable[[], TaskBatch], span: Span) -> None:
    # the return is a smooth function of the policy, also off the simplex
    made = tasks()
    problem, policy = exact_problem(made, span=span), random_table(made.enabled, 1).requires_grad_()
    gradient = policy_gradient(policy, problem)
    weights = torch.randn(made.num_tasks, generator=seeded(2), dtype=torch.float64)
    (backward,) = torch.autograd.grad(expected_return(policy, problem) @ weights, policy)
    assert _relative_error(backward, gradient * weights[:, None, None]) < 1e-12
    for seed in range(5):
        direction = torch.randn(policy.shape, generator=seeded(seed), dtype=torch.float64) * made.enabled
        slope = _central(lambda table: expected_return(table, problem), policy.detach(), direction)
        assert _relative_error((gradient * direction).sum(dim=(1, 2)), slope) < 1e-6


def test_every_entry_of_the_gradient_is_a_slope() -> None:
    tasks = ring_batch()
    problem, policy = exact_problem(tasks), random_table(tasks.enabled, 4)
    entries = torch.eye(policy[0].numel(), dtype=torch.float64).view(-1, *policy.shape[1:])
    slopes = [
        _central(lambda table: expected_return(table, problem), policy, entry.expand_as(policy))
        for entry in entries
    ]
    expected = torch.stack(slopes, dim=-1).view_as(policy)
    assert _relative_error(policy_gradient(policy, problem), expected) < 1e-6


@pytest.mark.parametrize("span", SPANS)
@pytest.mark.parametrize("tasks", BATCHES)
def test_the_hessian_product_is_the_slope_of_the_gradient(tasks: Callable[[], TaskBatch], span: Span) -> None:
    made = tasks()
    problem, policy = exact_problem(made, span=span), random_table(made.enabled, 1)
    for seed in range(5):
        direction = torch.randn(policy.shape, generator=seeded(seed), dtype=torch.float64) * made.enabled
        product = hessian_times(policy, direction, problem)
        slope = _central(lambda table: policy_gradient(table, problem), policy, direction)
        assert _relative_error(product, slope) < 1e-6


def _unrolled(policy: Tensor, tasks: TaskBatch, discount: float) -> Tensor:
    """The recursion over dense arrays [N, S, A, S], left to automatic differentiation."""
    arrives = torch.nn.functional.one_hot(tasks.next_state, tasks.num_states).to(tasks.dtype)
    goes_on = torch.einsum("nsak,nsakz->nsaz", tasks.survival, arrives)
    values = torch.zeros_like(tasks.initial)
    for _ in range(tasks.horizon):
        of_actions = tasks.expected_reward + discount * torch.einsum("nsaz,nz->nsa", goes_on, values)
        values = (policy * of_actions).sum(dim=-1)
    return (tasks.initial * values).sum(dim=-1)


@pytest.mark.parametrize("discount", [None, 1.0])
def test_derivatives_equal_those_of_the_unrolled_dense_recursion(discount: float | None) -> None:
    tasks = ring_batch()
    problem, policy = exact_problem(tasks, discount), random_table(tasks.enabled, 6).requires_grad_()
    dense = _unrolled(policy, tasks, RING_DISCOUNT if discount is None else discount)
    (gradient,) = torch.autograd.grad(dense.sum(), policy, create_graph=True)
    direction = torch.randn(policy.shape, generator=seeded(1), dtype=torch.float64)
    (product,) = torch.autograd.grad(gradient, policy, direction)
    found = policy_gradient(policy, problem)
    found_product = hessian_times(policy, direction, problem)
    torch.testing.assert_close(expected_return(policy, problem), dense, rtol=1e-12, atol=0)
    torch.testing.assert_close(found, gradient, rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(found_product, product, rtol=1e-10, atol=1e-12)


def test_disabled_actions_and_unreachable_states_have_no_gradient() -> None:
    tasks = grid_batch(0.2)
    gradient = policy_gradient(random_table(tasks.enabled, 0), exact_problem(tasks))
    assert torch.all(gradient[~tasks.enabled] == 0)
    assert torch.count_nonzero(gradient[tasks.enabled]) > 100


@pytest.mark.parametrize("discount", [0.5, 0.99])
def test_the_infinite_span_is_that_of_the_linear_equations(discount: float) -> None:
    """V = (1 - C)^-1 r with dense arrays, and the limit of ever longer horizons."""
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 8)
    found = expected_return(policy, exact_problem(tasks, discount, "infinite"))
    arrives = torch.nn.functional.one_hot(tasks.next_state, tasks.num_states).to(tasks.dtype)
    chain = discount * torch.einsum("nsa,nsak,nsakz->nsz", policy, tasks.survival, arrives)
    gains = (policy * tasks.expected_reward).sum(dim=-1)
    identity = torch.eye(tasks.num_states, dtype=tasks.dtype)
    solved = torch.linalg.solve(identity - chain, gains)
    torch.testing.assert_close(found, (tasks.initial * solved).sum(dim=-1), rtol=1e-10, atol=0)
    long = expected_return(policy, exact_problem(replace(tasks, horizon=3000), discount))
    torch.testing.assert_close(found, long, rtol=1e-10, atol=0)


def test_an_infinite_span_needs_a_discount() -> None:
    with pytest.raises(InputError, match="need a discount below 1, it is 1"):
        exact_problem(ring_batch(), 1.0, "infinite")


def test_single_precision_stays_single() -> None:
    tasks = grid_batch(0.2, torch.float32)
    policy = random_table(tasks.enabled, 3)
    found = expected_return(policy.float(), exact_problem(tasks))
    assert found.dtype == torch.float32
    exact = expected_return(policy, exact_problem(grid_batch(0.2)))
    # 18 steps of some 1e-7 each
    torch.testing.assert_close(found.double(), exact, rtol=1e-5, atol=0)
