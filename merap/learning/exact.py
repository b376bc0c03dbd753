"""The exact expected return of a policy, differentiable (`eq:lossmdp`).

Axes: N tasks, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd import Function
from torch.autograd.function import once_differentiable

from merap.learning import recursion
from merap.learning.tasks import TaskBatch


@dataclass(frozen=True, eq=False)
class ExactProblem:
    """A task batch laid out for the recursions.

    Attributes:
        arrays: the tasks as one MDP.
        num_tasks: N.
    """

    arrays: recursion.Problem
    num_tasks: int


def exact_problem(tasks: TaskBatch, discount: float | None = None) -> ExactProblem:
    """Lay out a task batch; `discount` replaces that of the tasks (1 for undiscounted returns)."""
    gamma = tasks.discount if discount is None else discount
    first_state = torch.arange(tasks.num_tasks, dtype=torch.int32) * tasks.num_states
    successor = (tasks.next_state.int() + first_state[:, None, None, None]).flatten(2).flatten(0, 1)
    num_rows, num_branches = successor.shape
    arrays = recursion.Problem(
        weight=(gamma * tasks.survival).flatten(0, 1).numpy(),
        reward=tasks.expected_reward.flatten(0, 1).numpy(),
        successor=successor.numpy(),
        row_pointers=np.arange(0, num_rows * num_branches + 1, num_branches, dtype=np.int32),
        initial=tasks.initial.flatten().numpy(),
        horizon=tasks.horizon,
    )
    return ExactProblem(arrays, tasks.num_tasks)


def expected_return(policy: Tensor, problem: ExactProblem) -> Tensor:
    """The exact expected return of a policy on each task; differentiable once in `policy`.

    Args:
        policy: float [N, S, A], a distribution over the enabled actions, 0 at the others.
        problem: the tasks.

    Returns:
        float [N].
    """
    result: Tensor = _Return.apply(policy, problem)  # type: ignore[no-untyped-call]
    return result


def policy_gradient(policy: Tensor, problem: ExactProblem) -> Tensor:
    """dJ/dpi(s, a) of the expected return J on each task; differentiable once in `policy`.

    Args:
        policy: as in `expected_return`.
        problem: the tasks.

    Returns:
        float [N, S, A]; 0 where an action is disabled.
    """
    result: Tensor = _Gradient.apply(policy, problem)  # type: ignore[no-untyped-call]
    return result


class _Return(Function):
    """J [N] of a policy [N, S, A]."""

    @staticmethod
    def forward(ctx: Any, policy: Tensor, problem: ExactProblem) -> Tensor:
        evaluation = recursion.evaluate(_rows(policy), problem.arrays)
        ctx.evaluation, ctx.problem = evaluation, problem
        earned = (problem.arrays.initial * evaluation.values[-1]).reshape(problem.num_tasks, -1)
        return torch.from_numpy(earned.sum(axis=1))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_return: Tensor) -> tuple[Tensor, None]:
        occupancy = recursion.occupancies(ctx.evaluation, ctx.problem.arrays)
        gradient = recursion.gradient(ctx.evaluation, occupancy, ctx.problem.arrays)
        return _tensor(gradient, ctx.problem) * of_return[:, None, None], None


class _Gradient(Function):
    """dJ/dpi of a policy, both [N, S, A]."""

    @staticmethod
    def forward(ctx: Any, policy: Tensor, problem: ExactProblem) -> Tensor:
        evaluation = recursion.evaluate(_rows(policy), problem.arrays)
        occupancy = recursion.occupancies(evaluation, problem.arrays)
        ctx.evaluation, ctx.occupancy, ctx.problem = evaluation, occupancy, problem
        return _tensor(recursion.gradient(evaluation, occupancy, problem.arrays), problem)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_gradient: Tensor) -> tuple[Tensor, None]:
        """The Hessian of J is symmetric, so its product from the left is that from the right."""
        product = recursion.hessian_product(
            ctx.evaluation, ctx.occupancy, _rows(of_gradient), ctx.problem.arrays
        )
        return _tensor(product, ctx.problem), None


def _rows(array: Tensor) -> recursion.Array:
    """[N * S, A] of [N, S, A]."""
    rows: recursion.Array = array.detach().flatten(0, 1).numpy()
    return rows


def _tensor(rows: recursion.Array, problem: ExactProblem) -> Tensor:
    """[N, S, A] of [N * S, A]."""
    return torch.from_numpy(rows).view(problem.num_tasks, -1, rows.shape[1])
