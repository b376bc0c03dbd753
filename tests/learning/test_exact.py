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
from merap.learning.config import Span
from merap.learning.exact import expected_return, plain_return, return_gradient
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp import evaluation
from merap.mdp.chain import induced_chain, write_induced_chain
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import TabularMDP
from tests.support.grid_tasks import ACTIONS, DISCOUNT, HORIZON, SIZE, grid_model, grid_task
from tests.support.learning_examples import (
    RING_DISCOUNT,
    RING_HORIZON,
    dense,
    grid_batch,
    grid_models,
    random_table,
    ring_batch,
    ring_models,
    seeded,
    with_end,
    with_horizon,
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
    for gamma in (discount, 1.0, 0.0):
        expected = [
            evaluation.expected_return(model, with_end(row, model), horizon, gamma)
            for model, row in zip(made, policy, strict=True)
        ]
        found = expected_return(policy, replace(tasks, discount=gamma))
        np.testing.assert_allclose(found.numpy(), expected, rtol=1e-12)


@pytest.mark.parametrize(("models", "horizon", "discount"), WORLDS)
def test_storm_values_the_induced_chain_the_same(
    models: Callable[[], list[TabularMDP]], horizon: int, discount: float, tmp_path: Path
) -> None:
    made = models()
    tasks = task_batch(made, horizon, discount, torch.float64)
    policy = random_table(tasks.enabled, 5)
    found = expected_return(policy, replace(tasks, discount=1.0))
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
    assert expected_return(policy.float(), replace(tasks, discount=1.0)).tolist() == [optimum]
    # geometric series of -0.5 over the way, then the prize
    discounted = -0.5 * (1 - DISCOUNT**steps) / (1 - DISCOUNT) + 10 * DISCOUNT**steps
    found = expected_return(policy.float(), tasks).item()
    assert found == pytest.approx(discounted, rel=1e-5)


Return = Callable[[Tensor, TaskBatch, Span], Tensor]


def policy_gradient(policy: Tensor, tasks: TaskBatch, span: Span, of: Return = expected_return) -> Tensor:
    """dJ/dpi [N, S, A]."""
    leaf = policy.detach().clone().requires_grad_()
    (gradient,) = torch.autograd.grad(of(leaf, tasks, span).sum(), leaf)
    return gradient


def hessian_times(
    policy: Tensor, direction: Tensor, tasks: TaskBatch, span: Span, of: Return = expected_return
) -> Tensor:
    """The Hessian of J times a direction [N, S, A]: a backward pass through a backward pass."""
    leaf = policy.detach().clone().requires_grad_()
    (gradient,) = torch.autograd.grad(of(leaf, tasks, span).sum(), leaf, create_graph=True)
    (product,) = torch.autograd.grad(gradient, leaf, direction)
    return product


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
    policy = random_table(made.enabled, 1).requires_grad_()
    gradient = policy_gradient(policy, made, span)
    weights = torch.randn(made.num_tasks, generator=seeded(2), dtype=torch.float64)
    (backward,) = torch.autograd.grad(expected_return(policy, made, span) @ weights, policy)
    assert _relative_error(backward, gradient * weights[:, None, None]) < 1e-12
    for seed in range(5):
        direction = torch.randn(policy.shape, generator=seeded(seed), dtype=torch.float64) * made.enabled
        slope = _central(lambda table: expected_return(table, made, span), policy.detach(), direction)
        assert _relative_error((gradient * direction).sum(dim=(1, 2)), slope) < 1e-6


def test_every_entry_of_the_gradient_is_a_slope() -> None:
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 4)
    entries = torch.eye(policy[0].numel(), dtype=torch.float64).view(-1, *policy.shape[1:])
    slopes = [
        _central(lambda table: expected_return(table, tasks), policy, entry.expand_as(policy))
        for entry in entries
    ]
    expected = torch.stack(slopes, dim=-1).view_as(policy)
    assert _relative_error(policy_gradient(policy, tasks, "horizon"), expected) < 1e-6


@pytest.mark.parametrize("span", SPANS)
@pytest.mark.parametrize("tasks", BATCHES)
def test_the_hessian_product_is_the_slope_of_the_gradient(tasks: Callable[[], TaskBatch], span: Span) -> None:
    made = tasks()
    policy = random_table(made.enabled, 1)
    for seed in range(5):
        direction = torch.randn(policy.shape, generator=seeded(seed), dtype=torch.float64) * made.enabled
        product = hessian_times(policy, direction, made, span)
        slope = _central(lambda table: policy_gradient(table, made, span), policy, direction)
        assert _relative_error(product, slope) < 1e-6


def _unrolled(policy: Tensor, tasks: TaskBatch, discount: float) -> Tensor:
    """The recursion over dense arrays [N, S, A, S], left to automatic differentiation."""
    goes_on = dense(tasks, tasks.branch_prob * tasks.branch_continuation)
    values = torch.zeros_like(tasks.initial)
    for _ in range(tasks.longest_horizon):
        of_actions = tasks.expected_reward + discount * torch.einsum("nsaz,nz->nsa", goes_on, values)
        values = (policy * of_actions).sum(dim=-1)
    return (tasks.initial * values).sum(dim=-1)


@pytest.mark.parametrize("discount", [RING_DISCOUNT, 1.0])
def test_derivatives_equal_those_of_the_unrolled_dense_recursion(discount: float) -> None:
    tasks = replace(ring_batch(), discount=discount)
    policy = random_table(tasks.enabled, 6).requires_grad_()
    unrolled = _unrolled(policy, tasks, discount)
    (gradient,) = torch.autograd.grad(unrolled.sum(), policy, create_graph=True)
    direction = torch.randn(policy.shape, generator=seeded(1), dtype=torch.float64)
    (product,) = torch.autograd.grad(gradient, policy, direction)
    found = policy_gradient(policy, tasks, "horizon")
    found_product = hessian_times(policy, direction, tasks, "horizon")
    torch.testing.assert_close(expected_return(policy, tasks), unrolled, rtol=1e-12, atol=0)
    torch.testing.assert_close(found, gradient, rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(found_product, product, rtol=1e-10, atol=1e-12)


def test_disabled_actions_and_unreachable_states_have_no_gradient() -> None:
    tasks = grid_batch(0.2)
    gradient = policy_gradient(random_table(tasks.enabled, 0), tasks, "horizon")
    assert torch.all(gradient[~tasks.enabled] == 0)
    assert torch.count_nonzero(gradient[tasks.enabled]) > 100


@pytest.mark.parametrize("discount", [0.5, 0.99])
def test_the_infinite_span_is_that_of_the_linear_equations(discount: float) -> None:
    """V = (1 - C)^-1 r with dense arrays, and the limit of ever longer horizons."""
    tasks = replace(ring_batch(), discount=discount)
    policy = random_table(tasks.enabled, 8)
    found = expected_return(policy, tasks, "infinite")
    chain = torch.einsum("nsa,nsaz->nsz", policy, dense(tasks, tasks.weight))
    gains = (policy * tasks.expected_reward).sum(dim=-1)
    identity = torch.eye(tasks.num_states, dtype=tasks.dtype)
    solved = torch.linalg.solve(identity - chain, gains)
    torch.testing.assert_close(found, (tasks.initial * solved).sum(dim=-1), rtol=1e-10, atol=0)
    long = expected_return(policy, with_horizon(tasks, 3000))
    torch.testing.assert_close(found, long, rtol=1e-10, atol=0)


def test_an_infinite_span_needs_a_discount() -> None:
    with pytest.raises(InputError, match="need a discount below 1, it is 1"):
        expected_return(
            random_table(ring_batch().enabled, 0), replace(ring_batch(), discount=1.0), "infinite"
        )


def test_single_precision_stays_single() -> None:
    tasks = grid_batch(0.2, torch.float32)
    policy = random_table(tasks.enabled, 3)
    found = expected_return(policy.float(), tasks)
    assert found.dtype == torch.float32
    exact = expected_return(policy, grid_batch(0.2))
    # 18 steps of some 1e-7 each
    torch.testing.assert_close(found.double(), exact, rtol=1e-5, atol=0)


@pytest.mark.parametrize("span", SPANS)
@pytest.mark.parametrize("tasks", BATCHES)
def test_plain_torch_is_the_second_route(tasks: Callable[[], TaskBatch], span: Span) -> None:
    """Values, gradients and Hessian products, left to automatic differentiation."""
    made = tasks()
    made = with_horizon(made, [7, made.longest_horizon, 2][: made.num_tasks])
    policy = random_table(made.enabled, 2)
    direction = torch.randn(policy.shape, generator=seeded(3), dtype=torch.float64)
    torch.testing.assert_close(
        expected_return(policy, made, span), plain_return(policy, made, span), rtol=1e-10, atol=0
    )
    for derivative in (policy_gradient, lambda *given: hessian_times(given[0], direction, *given[1:])):
        found, plain = (derivative(policy, made, span, of) for of in (expected_return, plain_return))
        assert _relative_error(found, plain) < 1e-10


def test_tasks_may_have_horizons_of_their_own() -> None:
    tasks, horizons = ring_batch(), [3, 12, 1]
    policy = random_table(tasks.enabled, 5)
    together = with_horizon(tasks, horizons)
    direction = torch.randn(policy.shape, generator=seeded(3), dtype=torch.float64)
    for n, horizon in enumerate(horizons):
        alone, own = with_horizon(tasks[[n]], horizon), policy[n : n + 1]
        assert expected_return(policy, together)[n] == expected_return(own, alone)[0]
        found = policy_gradient(policy, together, "horizon")[n]
        assert torch.equal(found, policy_gradient(own, alone, "horizon")[0])
        product = hessian_times(policy, direction, together, "horizon")[n]
        assert torch.equal(product, hessian_times(own, direction[n : n + 1], alone, "horizon")[0])


@pytest.mark.parametrize("span", SPANS)
def test_a_deterministic_policy_has_the_gradient_of_what_it_never_does(span: Span) -> None:
    """What is never done is 0 in the policy, but not in its derivatives."""
    tasks = ring_batch()
    wanted = random_table(tasks.enabled, 3).argmax(dim=-1)
    policy = torch.nn.functional.one_hot(wanted, tasks.num_actions).double() * tasks.enabled
    direction = torch.randn(policy.shape, generator=seeded(4), dtype=torch.float64)
    found, plain = (policy_gradient(policy, tasks, span, of) for of in (expected_return, plain_return))
    torch.testing.assert_close(found, plain, rtol=1e-9, atol=1e-10)
    found, plain = (
        hessian_times(policy, direction, tasks, span, of) for of in (expected_return, plain_return)
    )
    torch.testing.assert_close(found, plain, rtol=1e-9, atol=1e-10)


def test_a_hessian_product_is_differentiable_in_its_direction() -> None:
    """The Hessian is symmetric: u' H v has the gradient H u in v."""
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 1).requires_grad_()
    (gradient,) = torch.autograd.grad(expected_return(policy, tasks).sum(), policy, create_graph=True)
    one, other = torch.randn(2, *policy.shape, generator=seeded(5), dtype=torch.float64)
    direction = one.clone().requires_grad_()
    (product,) = torch.autograd.grad(gradient, policy, direction, create_graph=True)
    (found,) = torch.autograd.grad(product, direction, other)
    torch.testing.assert_close(found, hessian_times(policy, other, tasks, "horizon"))


def test_a_third_derivative_is_refused() -> None:
    tasks = ring_batch()
    policy = random_table(tasks.enabled, 1).requires_grad_()
    gradient = return_gradient(policy, tasks)
    (product,) = torch.autograd.grad(gradient.sum(), policy, create_graph=True)
    with pytest.raises(RuntimeError):
        torch.autograd.grad(product.sum(), policy)
