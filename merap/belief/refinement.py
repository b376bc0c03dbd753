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

import numpy as np
import torch
from torch import Tensor

from merap.belief.model import DomainModel, sampled_model
from merap.belief.planning import FinitePlan, Refined, plan, policy_values
from merap.belief.posterior import Belief
from merap.belief.space import HypothesisSpace
from merap.learning.exact import ExactProblem, exact_problem, expected_return
from merap.learning.meta import MetaPolicy
from merap.learning.policy import Parameters, policy_table
from merap.learning.tasks import TaskBatch
from merap.mdp.model import Floats

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
        meta: the meta policy, of the same case.
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
        self._meta = meta
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
        problem = exact_problem(tasks, discount=1)
        parameters, scale = self._meta.parameters, 1.0
        for _ in range(self._settings.steps):
            stepped = self._stepped(parameters, tasks, problem, scale)
            if stepped is None:
                break
            parameters, scale = stepped
        with torch.no_grad():
            anything = tasks.enabled.any(dim=0)
            table: Floats = policy_table(self._meta.network, parameters, anything).double().numpy()
        return table[:-1]

    def _stepped(
        self, parameters: Parameters, tasks: TaskBatch, problem: ExactProblem, scale: float
    ) -> tuple[Parameters, float] | None:
        """Up the gradient along the learned step sizes, as far as it improves; None if it does not."""
        leaves = {name: value.detach().requires_grad_() for name, value in parameters.items()}
        value = self._value(leaves, tasks, problem)
        gradient = dict(zip(leaves, torch.autograd.grad(value, tuple(leaves.values())), strict=True))
        with torch.no_grad():
            for halving in range(self._settings.halvings):
                length = scale / 2**halving
                moved = {
                    name: leaf + length * self._meta.step_sizes[name] * gradient[name]
                    for name, leaf in parameters.items()
                }
                if self._value(moved, tasks, problem) > value:
                    return moved, 2 * length
        return None

    def _value(self, parameters: Parameters, tasks: TaskBatch, problem: ExactProblem) -> Tensor:
        return expected_return(policy_table(self._meta.network, parameters, tasks.enabled), problem).mean()


def model_tasks(models: Sequence[DomainModel], start: Floats, horizon: int) -> TaskBatch:
    """Domain models side by side, on the canonical index with the completed state.

    Args:
        models: N of them.
        start: float64 [S].
        horizon: T.
    """
    num_states = len(start)
    shape = (len(models), num_states + 1, *np.shape(models[0].target)[::2])
    next_state = np.broadcast_to(np.arange(num_states + 1)[:, np.newaxis, np.newaxis], shape).copy()
    prob, reward, continuation = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    enabled = np.zeros(shape[:3], dtype=np.bool_)
    for n, model in enumerate(models):
        next_state[n, :-1] = model.target.transpose(1, 0, 2)
        prob[n, :-1] = model.prob.transpose(1, 0, 2)
        reward[n, :-1] = model.reward.transpose(1, 0, 2)
        continuation[n, :-1] = model.continuation.transpose(1, 0, 2)
        enabled[n, :-1] = model.enabled.T
    return TaskBatch(
        next_state=torch.from_numpy(next_state),
        prob=torch.from_numpy(prob).float(),
        reward=torch.from_numpy(reward).float(),
        continuation=torch.from_numpy(continuation).float(),
        enabled=torch.from_numpy(enabled),
        initial=torch.from_numpy(np.tile(np.append(start, 0.0), (len(models), 1))).float(),
        horizon=horizon,
        discount=1.0,
    )
