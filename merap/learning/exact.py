"""The exact expected return of a policy on known models, differentiable by torch (`eq:lossmdp`).

Axes: N tasks, S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor
from torch.autograd import Function
from torch.autograd.function import once_differentiable

from merap.errors import InputError
from merap.learning.core.task import Tasks
from merap.learning.core.values import values
from merap.learning.layout import array_of, core_tasks
from merap.learning.tasks import TaskBatch

Span = Literal["horizon", "infinite"]


@dataclass(frozen=True, eq=False)
class ExactProblem:
    """A task batch laid out for exact values.

    Attributes:
        tasks: N of them.
        horizon: T; 0: infinite.
    """

    tasks: Tasks
    horizon: int


def exact_problem(tasks: TaskBatch, discount: float | None = None, span: Span = "horizon") -> ExactProblem:
    """Lay out a task batch.

    Args:
        tasks: the batch.
        discount: in place of that of the tasks (1 for undiscounted returns).
        span: `horizon`: the return over the tasks' horizon; `infinite`: the discounted return of
            an episode that is never cut.

    Raises:
        InputError: an infinite span without a discount.
    """
    gamma = tasks.discount if discount is None else discount
    require_span(span, gamma)
    return ExactProblem(core_tasks(tasks, gamma), tasks.horizon if span == "horizon" else 0)


def require_span(span: Span, discount: float) -> None:
    """Raises InputError if returns over that span may have no value."""
    if span == "infinite" and not discount < 1:
        raise InputError(f"values over an infinite horizon need a discount below 1, it is {discount:g}")


def expected_return(policy: Tensor, problem: ExactProblem) -> Tensor:
    """The exact expected return of a policy on each task; differentiable once in `policy` by torch.

    Args:
        policy: float [N, S, A], a distribution over the enabled actions, 0 at the others.
        problem: the tasks.

    Returns:
        float [N].
    """
    result: Tensor = _Return.apply(policy, problem)  # type: ignore[no-untyped-call]
    return result


class _Return(Function):
    """J [N] of a policy [N, S, A]."""

    @staticmethod
    def forward(ctx: Any, policy: Tensor, problem: ExactProblem) -> Tensor:
        found = values(array_of(policy), problem.tasks, problem.horizon)
        ctx.gradient = torch.from_numpy(found.gradient)
        return torch.from_numpy(found.total)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_return: Tensor) -> tuple[Tensor, None]:
        return ctx.gradient * of_return[:, None, None], None
