"""The exact expected return of policies on known tasks, twice differentiable by torch (`eq:lossmdp`).

Over a horizon of T steps J = initial' V_T with

    V_h(s) = sum_a pi(s, a) Q_h(s, a),   Q_h(s, a) = r(s, a) + sum_b w(b) V_h-1(s'_b),   V_0 = 0

with h steps to go and w the discounted probability to go on along a branch b. Its gradient is
dJ/dpi(s, a) = sum_t d_t(s) Q_T-t(s, a) with the discounted probability d_t to be in s at time t
(Sutton et al. 2000, theorem 1). A Hessian product is the derivative of both recursions along a direction.

Over an infinite horizon V = r + C V and d = initial + C' d with C(s, s') = sum_a pi(s, a) w(s, a, s') are
differentiated as such, not through the sweeps that find them (the implicit function theorem):
dJ/dpi(s, a) = d(s) Q(s, a), and along a direction V. = r. + C. V + C V. and d. = C.' d + C' d. are solved
like V and d. Cost and memory do not grow with T.

On the CPU the recursions are compiled; `plain_return` is the same function in plain torch, for other devices.

Axes: N tasks, S states, A actions, M branches of all these tasks, H steps of the longest horizon.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd import Function
from torch.autograd.function import once_differentiable

from merap.errors import InputError
from merap.learning import kernels
from merap.learning.config import Span
from merap.learning.tasks import TaskBatch


def require_span(span: Span, discount: float) -> None:
    """Raises InputError if returns over that span may have no value."""
    if span == "infinite" and not discount < 1:
        raise InputError(f"values over an infinite horizon need a discount below 1, it is {discount:g}")


def expected_return(policy: Tensor, tasks: TaskBatch, span: Span = "horizon") -> Tensor:
    """Return the exact expected discounted return of a policy on each task; twice differentiable in it.

    Args:
        policy: float [N, S, A], a distribution over the enabled actions, 0 at the others.
        tasks: N of them, of the policy's precision.
        span: `horizon`: the return over the tasks' horizons; `infinite`: the discounted return of an
            episode that is never cut.

    Returns:
        float [N].

    Raises:
        InputError: an infinite span without a discount.
    """
    require_span(span, tasks.discount)
    if policy.device.type != "cpu":
        return plain_return(policy, tasks, span)
    result: Tensor = _Return.apply(policy, tasks, span)  # type: ignore[no-untyped-call]
    return result


def return_gradient(
    policy: Tensor, tasks: TaskBatch, span: Span = "horizon", known: Evaluation | None = None
) -> Tensor:
    """Return dJ/dpi, float [N, S, A], differentiable once; `known` is what `evaluate` says of the policy."""
    known = known or evaluate(policy, tasks, span)
    gradient: Tensor = _Gradient.apply(policy, known)  # type: ignore[no-untyped-call]
    return gradient


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What policies are worth, without a graph.

    Attributes:
        tasks: N of them.
        to_go: float [N, H + 1, S], V_h with h steps to go; over an infinite horizon [N, 1, S].
        occupancy: float [N, H + 1, S], d_t; over an infinite horizon [N, 1, S], the visits.
        visits: float [N, S], discounted number of steps that begin in a state.
        total: float [N], J.
        gradient: float [N, S, A], dJ/dpi, 0 where an action is disabled.
    """

    tasks: TaskBatch
    to_go: Tensor
    occupancy: Tensor
    visits: Tensor
    total: Tensor
    gradient: Tensor


@torch.no_grad()
def evaluate(policy: Tensor, tasks: TaskBatch, span: Span = "horizon") -> Evaluation:
    """Return J, its gradient and what they are made of; arguments as in `expected_return`."""
    if span == "infinite":
        return _evaluate_infinite(policy, tasks)
    num_tasks, num_states, _ = policy.shape
    to_go, occupancy = torch.zeros(2, num_tasks, tasks.longest_horizon + 1, num_states, dtype=policy.dtype)
    visits, total = policy.new_empty(num_tasks, num_states), policy.new_zeros(num_tasks)
    gradient = torch.empty_like(policy, memory_format=torch.contiguous_format)
    filled = tuple(array.numpy() for array in (to_go, occupancy, visits, total, gradient))
    scratch = np.empty((2, tasks.most_branches), dtype=filled[0].dtype)
    kernels.evaluate(_array(policy), tasks.arrays, filled, *scratch)
    return Evaluation(tasks, to_go, occupancy, visits, total, gradient)


def _hessian_product(policy: Tensor, direction: Tensor, found: Evaluation) -> Tensor:
    """float [N, S, A], the Hessian of J at a policy times a direction [N, S, A]."""
    tasks, arrays = found.tasks, (_array(policy), _array(direction))
    if found.to_go.shape[1] == 1:
        return _infinite_hessian_product(policy, direction, found)
    product = torch.empty_like(policy, memory_format=torch.contiguous_format)
    shapes = ((3, tasks.most_branches), (tasks.longest_horizon + 5, tasks.num_states))
    scratch = tuple(np.empty(shape, dtype=arrays[0].dtype) for shape in shapes)
    known = (found.to_go.numpy(), found.occupancy.numpy())
    kernels.hessian_product(*arrays, tasks.arrays, known, product.numpy(), scratch)
    return product


class _Return(Function):
    """J [N] of a policy [N, S, A]."""

    @staticmethod
    def forward(ctx: Any, policy: Tensor, tasks: TaskBatch, span: Span) -> Tensor:
        ctx.found = evaluate(policy, tasks, span)
        ctx.save_for_backward(policy)
        # a tensor of its own: what is returned refers to ctx, which must not refer to it
        total: Tensor = ctx.found.total.detach()
        return total

    @staticmethod
    def backward(ctx: Any, weight: Tensor) -> tuple[Tensor, None, None]:
        gradient: Tensor = _Gradient.apply(*ctx.saved_tensors, ctx.found)  # type: ignore[no-untyped-call]
        return weight[:, None, None] * gradient, None, None


class _Gradient(Function):
    """dJ/dpi [N, S, A] of a policy."""

    @staticmethod
    def forward(ctx: Any, policy: Tensor, found: Evaluation) -> Tensor:
        ctx.found = found
        ctx.save_for_backward(policy)
        return found.gradient.detach()

    @staticmethod
    def backward(ctx: Any, direction: Tensor) -> tuple[Tensor, None]:
        (policy,) = ctx.saved_tensors
        product: Tensor = _HessianProduct.apply(direction, policy, ctx.found)  # type: ignore[no-untyped-call]
        return product, None


class _HessianProduct(Function):
    """The Hessian of J times a direction [N, S, A], in which it is linear and differentiable."""

    @staticmethod
    def forward(ctx: Any, direction: Tensor, policy: Tensor, found: Evaluation) -> Tensor:
        ctx.policy, ctx.found = policy.detach(), found
        return _hessian_product(policy, direction, found)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, cotangent: Tensor) -> tuple[Tensor, None, None]:
        return _hessian_product(ctx.policy, cotangent, ctx.found), None, None


def plain_return(policy: Tensor, tasks: TaskBatch, span: Span = "horizon") -> Tensor:
    """Return what `expected_return` does, in plain torch, on the device that policy and tasks are on.

    Over an infinite span it solves dense equations.
    """
    require_span(span, tasks.discount)
    shape, branches = tasks.initial.shape, tasks.branches
    chain = policy.flatten()[branches.choice] * tasks.weight[branches.number]
    gains = (policy * tasks.expected_reward).sum(dim=-1).flatten()
    if span == "infinite":
        num_states = shape[1]
        row = branches.source * num_states + branches.target % num_states
        dense = torch.zeros(len(gains) * num_states, dtype=chain.dtype, device=chain.device)
        dense = dense.index_add(0, row, chain).view(*shape, num_states)
        identity = torch.eye(num_states, dtype=chain.dtype, device=chain.device)
        values: Tensor = torch.linalg.solve(identity - dense, gains.view(shape))
        return (tasks.initial * values).sum(dim=1)
    values = torch.zeros_like(gains)
    ends = tasks.horizon.repeat_interleave(shape[1])
    for h in range(tasks.longest_horizon):
        following = gains.index_add(0, branches.source, chain * values[branches.target])
        values = torch.where(h < ends, following, values)
    return (tasks.initial * values.view(shape)).sum(dim=1)


def _evaluate_infinite(policy: Tensor, tasks: TaskBatch) -> Evaluation:
    chain = _chain(policy, tasks)
    to_go = _solved(kernels.solve_values, (policy * tasks.expected_reward).sum(dim=-1), chain, tasks)
    visits = _solved(kernels.solve_visits, tasks.initial, chain, tasks)
    met = visits.flatten()[tasks.branches.source] * to_go.flatten()[tasks.branches.target]
    gradient = _collected(visits, met, tasks)
    total = (tasks.initial * to_go).sum(dim=1)
    return Evaluation(tasks, to_go.unsqueeze(1), visits.unsqueeze(1), visits, total, gradient)


def _infinite_hessian_product(policy: Tensor, direction: Tensor, found: Evaluation) -> Tensor:
    tasks, visits, to_go = found.tasks, found.visits, found.to_go[:, 0]
    source, target = tasks.branches.source, tasks.branches.target
    chain, chain_dot = _chain(policy, tasks), _chain(direction, tasks)
    gains_dot = (direction * tasks.expected_reward).sum(dim=-1)
    gains_dot.view(-1).index_add_(0, source, chain_dot * to_go.flatten()[target])
    to_go_dot = _solved(kernels.solve_values, gains_dot, chain, tasks)
    arrivals = torch.zeros_like(visits)
    arrivals.view(-1).index_add_(0, target, chain_dot * visits.flatten()[source])
    visits_dot = _solved(kernels.solve_visits, arrivals, chain, tasks)
    met_dot = visits_dot.flatten()[source] * to_go.flatten()[target]
    met_dot += visits.flatten()[source] * to_go_dot.flatten()[target]
    return _collected(visits_dot, met_dot, tasks)


def _chain(policy: Tensor, tasks: TaskBatch) -> Tensor:
    """float [M], discounted probability to go on along a branch; linear in a policy [N, S, A]."""
    return policy.flatten()[tasks.branches.choice] * tasks.weight[tasks.branches.number]


def _collected(visits: Tensor, met: Tensor, tasks: TaskBatch) -> Tensor:
    """float [N, S, A]: visits(s) r(s, a) + sum_b w(b) met(b), of visits [N, S] and met [M]."""
    result = visits.unsqueeze(-1) * tasks.expected_reward
    result.view(-1).index_add_(0, tasks.branches.choice, tasks.weight[tasks.branches.number] * met)
    return result


def _solved(solve: Callable[..., None], given: Tensor, chain: Tensor, tasks: TaskBatch) -> Tensor:
    """float [N, S], the fixed point of each task from what is given [N, S]."""
    _, ends, target, *_ = tasks.arrays
    left, result = given.clone().numpy(), torch.zeros_like(given)
    done = 0
    for n, of_states in enumerate(ends):
        links = chain.numpy()[done : done + of_states[-1] - of_states[0]]
        done += len(links)
        solve(of_states - of_states[0], target[of_states[0] :], links, left[n], result[n].numpy())
    return result


def _array(tensor: Tensor) -> Any:
    """The same numbers, contiguous."""
    return tensor.detach().contiguous().numpy()
