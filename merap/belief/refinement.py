"""The policy of a belief: the meta policy after exact gradient steps, or the plan where that is better.

The plan is best for the mean model, but the mean of models is none of them: while the belief is
spread, a policy that hedges can be worth more. So the meta policy climbs the exact gradient of the
mean return over models drawn from the belief (`eq:adaptation` with the posterior in place of
episodes), and both are judged by their exact returns on models drawn afresh.

Axes as in `space`; N models, T steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from merap.belief.model import DomainModel, sampled_model
from merap.belief.planning import FinitePlan, Refined, plan, policy_values
from merap.belief.posterior import Belief
from merap.belief.space import HypothesisSpace
from merap.learning.exact import expected_return
from merap.learning.meta import MetaPolicy
from merap.learning.policy import Parameters, policy_table
from merap.learning.tasks import TaskBatch, branch_batch
from merap.mdp.model import Floats
from merap.runs.policy_on_index import on_index

# Of what an informed policy earns above the plan, in units of the range of rewards.
NEGLIGIBLE_GAP = 1e-3


@dataclass(frozen=True)
class RefinementSettings:
    """How the meta policy is refined.

    Attributes:
        models: N, drawn for the gradient, and as many again to judge by.
        steps: gradient steps from the meta policy.
        halvings: of a step that does not improve, before climbing ends.
    """

    models: int = 16
    steps: int = 10
    halvings: int = 6


class Refinement:
    """Refines the meta policy of a run by a belief.

    Args:
        meta: the meta policy of the same case, on the index of the space.
        space: the hypotheses of the case.
        horizon: T.
        generator: of the models that are drawn.
        settings: how.
    """

    def __init__(
        self,
        meta: MetaPolicy,
        space: HypothesisSpace,
        horizon: int,
        generator: np.random.Generator,
        settings: RefinementSettings | None = None,
    ) -> None:
        self._meta = on_index(meta, space.index, space.states)
        self._space = space
        self._horizon = horizon
        self._generator = generator
        self._settings = settings or RefinementSettings()
        self._negligible = NEGLIGIBLE_GAP * (float(np.ptp(space.reward)) or 1.0)

    def __call__(self, belief: Belief, best: FinitePlan, plan_policy: Floats, start: Floats) -> Refined:
        """The better of two policies.

        Args:
            belief: the posterior.
            best: the plan on its mean.
            plan_policy: float64 [T, S, A], the same as a policy.
            start: float64 [S].
        """
        judging = self._drawn(belief)
        informed = np.mean([plan(model, self._horizon).values[0] @ start for model in judging])
        plan_value = float(policy_values(judging, plan_policy, start).mean())
        if informed - plan_value <= self._negligible:
            return Refined(None, plan_value, None)
        policy = self._climbed(self._drawn(belief), start)
        repeated = np.broadcast_to(policy, (self._horizon, *policy.shape))
        refined_value = float(policy_values(judging, repeated, start).mean())
        return Refined(policy if refined_value > plan_value else None, plan_value, refined_value)

    def _drawn(self, belief: Belief) -> list[DomainModel]:
        return [sampled_model(self._space, belief, self._generator) for _ in range(self._settings.models)]

    def _climbed(self, models: Sequence[DomainModel], start: Floats) -> Floats:
        """float64 [S, A], the meta policy after gradient steps."""
        tasks = model_tasks(models, start, self._horizon)
        parameters, scale = self._meta.parameters, 1.0
        for _ in range(self._settings.steps):
            stepped = self._stepped(parameters, tasks, scale)
            if stepped is None:
                break
            parameters, scale = stepped
        with torch.no_grad():
            anything = tasks.enabled.any(dim=0)
            table: Floats = policy_table(self._meta.network, parameters, anything).double().numpy()
        return table[:-1]

    def _stepped(
        self, parameters: Parameters, tasks: TaskBatch, scale: float
    ) -> tuple[Parameters, float] | None:
        """Up the gradient along the learned step sizes, as far as it improves; None if it does not."""
        leaves = {name: value.detach().requires_grad_() for name, value in parameters.items()}
        value = self._value(leaves, tasks)
        gradient = dict(zip(leaves, torch.autograd.grad(value, tuple(leaves.values())), strict=True))
        with torch.no_grad():
            for halving in range(self._settings.halvings):
                length = scale / 2**halving
                moved = {
                    name: leaf + length * self._meta.step_sizes[name] * gradient[name]
                    for name, leaf in parameters.items()
                }
                if self._value(moved, tasks) > value:
                    return moved, 2 * length
        return None

    def _value(self, parameters: Parameters, tasks: TaskBatch) -> Tensor:
        return expected_return(policy_table(self._meta.network, parameters, tasks.enabled), tasks).mean()


def model_tasks(models: Sequence[DomainModel], start: Floats, horizon: int) -> TaskBatch:
    """Domain models side by side, on the states of the belief with the completed one.

    Args:
        models: N of them.
        start: float64 [S].
        horizon: T.
    """
    enabled = np.stack([model.enabled.T for model in models])  # [N, S, A]
    enabled = np.pad(enabled, ((0, 0), (0, 1), (0, 0)))

    def of_branches(name: str) -> npt.NDArray[Any]:
        """[N, S + 1, A, K] of [A, S, K] each; the completed state has none."""
        table = np.stack([getattr(model, name).transpose(1, 0, 2) for model in models])
        return np.pad(table, ((0, 0), (0, 1), (0, 0), (0, 0)))

    prob = of_branches("prob")
    real = (prob > 0) & enabled[..., np.newaxis]
    return branch_batch(
        np.flatnonzero(real) // prob.shape[-1],
        of_branches("target")[real],
        prob[real],
        of_branches("reward")[real],
        of_branches("continuation")[real],
        enabled,
        np.tile(np.append(start, 0.0), (len(models), 1)),
        horizon,
        1.0,
    )
