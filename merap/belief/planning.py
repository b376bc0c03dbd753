"""Plans on a belief: what is best for the mean, and where it pays to look.

Axes as in `space`; T steps that remain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.belief.model import DomainModel
from merap.belief.posterior import Belief, weights
from merap.belief.space import HypothesisSpace
from merap.mdp.model import Bools, Floats, Ints

IMPOSSIBLE = -1e18
# Objectives whose own optimum counts in the price of information: the likeliest of these many.
MAX_OBJECTIVES = 64
CERTAIN = 1e-12


@dataclass(frozen=True, eq=False)
class FinitePlan:
    """A time-indexed policy on a domain model.

    Attributes:
        values: float64 [T + 1, S], expected return of the steps from t on.
        actions: int64 [T, S].
        ranked: float64 [T, S, A], what each action is worth; -1e18 where it is not possible.
    """

    values: Floats
    actions: Ints
    ranked: Floats


@dataclass(frozen=True, eq=False)
class Refined:
    """What became of the plan on the mean.

    Attributes:
        policy: float64 [S, A] without the completed state, better than the plan; None: the plan is kept.
        plan_value: exact mean return of the plan over models of the belief.
        refined_value: likewise of the other policy; None: none could gain on the plan.
    """

    policy: Floats | None
    plan_value: float
    refined_value: float | None

    @property
    def reason(self) -> str:
        """In words."""
        worth = f"the plan on the mean is worth {self.plan_value:.3g} over the models of the belief"
        if self.refined_value is None:
            return f"{worth} and none can gain on it: the plan is kept"
        chosen = "the plan is kept" if self.policy is None else "that is taken"
        return f"{worth}, the meta policy after exact gradient steps {self.refined_value:.3g}: {chosen}"


def plan(
    model: DomainModel, horizon: int, extra: Floats | None = None, ties: Floats | None = None
) -> FinitePlan:
    """Backward induction.

    Args:
        model: of the domain.
        horizon: T.
        extra: float64 [A, S], added to the rewards.
        ties: float64 [A, S], tiny preferences among actions that are equally good.
    """
    num_actions, num_states = model.enabled.shape
    expected = np.einsum("ask,ask->as", model.prob, model.reward)
    if extra is not None:
        expected = expected + extra
    onward = model.prob * model.continuation
    possible = model.enabled.any(axis=0)
    values = np.zeros((horizon + 1, num_states))
    ranked = np.empty((horizon, num_actions, num_states))
    for t in reversed(range(horizon)):
        of_actions = expected + (onward * values[t + 1][model.target]).sum(axis=2)
        ranked[t] = np.where(model.enabled, of_actions, IMPOSSIBLE)
        values[t] = np.where(possible, ranked[t].max(axis=0), 0.0)
    preferred = ranked if ties is None else ranked + ties
    return FinitePlan(values, preferred.argmax(axis=1), preferred.transpose(0, 2, 1))


def policy_values(models: Sequence[DomainModel], policy: Floats, start: Floats) -> Floats:
    """The exact expected returns of a policy.

    Args:
        models: N of one case.
        policy: float64 [T, S, A]; zero where an action is not possible, the rest in proportion,
            uniform where nothing is left.
        start: float64 [S].

    Returns:
        float64 [N].
    """
    target, enabled = models[0].target, np.stack([model.enabled.T for model in models])  # [N, S, A]
    prob = np.stack([model.prob for model in models])  # [N, A, S, K]
    expected = np.einsum("nask,nask->nsa", prob, np.stack([model.reward for model in models]))
    onward = prob * np.stack([model.continuation for model in models])
    values = np.zeros(enabled.shape[:2])
    for shares in policy[::-1]:
        share = shares * enabled
        share = np.where(share.sum(axis=2, keepdims=True) > 0, share, enabled)
        share = share / np.maximum(share.sum(axis=2, keepdims=True), 1e-300)
        of_actions = expected + np.einsum("nask,nask->nsa", onward, values[:, target])
        values = (share * of_actions).sum(axis=2)
    returns: Floats = values @ start
    return returns


def objective_information(space: HypothesisSpace, belief: Belief, model: DomainModel) -> Floats:
    """How much a step would tell of the objective, in nats: float64 [A, S].

    The mutual information of the objective and of what a step pays and whether it ends the task,
    noise on rewards left out.
    """
    _, objective = weights(belief)
    mass = objective.sum(axis=1)
    likely = np.flatnonzero(mass > CERTAIN)
    if len(likely) == 1:
        return np.zeros(model.enabled.shape)
    u = int(np.bincount(space.attribute_class[belief.environments]).argmax())
    codes = space.outcome_codes[u][likely]
    share = np.stack(
        [np.tensordot(mass[likely], codes == code, 1) for code in range(int(codes.max(initial=0)) + 1)]
    )
    entropy = -np.sum(share * np.log(np.where(share > 0, share, 1.0)), axis=0)
    information: Floats = np.einsum("ask,ask->as", model.prob, entropy)
    return np.maximum(information, 0.0)


def information_price(
    space: HypothesisSpace, belief: Belief, model: DomainModel, plan_: FinitePlan, start: Floats
) -> float:
    """What a nat about the objective is worth per episode to come.

    The gain of knowing the objective, `E_o[max_pi V_o] - max_pi E_o[V_o]`, over its entropy.

    Args:
        space: the hypotheses.
        belief: the posterior.
        model: its mean.
        plan_: the best plan of the mean.
        start: float64 [S].
    """
    _, objective = weights(belief)
    mass = objective.sum(axis=1)
    entropy = -float(np.sum(mass * np.log(np.where(mass > 0, mass, 1.0))))
    if entropy < 1e-9:
        return 0.0
    likely = np.argsort(-mass)[:MAX_OBJECTIVES]
    likely = likely[mass[likely] > 1e-9]
    u = int(np.bincount(space.attribute_class[belief.environments]).argmax())
    best = _best_values(model, space.reward[u, likely], space.ends[u, likely], len(plan_.actions)) @ start
    informed = float(mass[likely] @ best / mass[likely].sum())
    return max(0.0, informed - float(plan_.values[0] @ start)) / entropy


def _best_values(model: DomainModel, reward: Floats, ends: Bools, horizon: int) -> Floats:
    """float64 [O, S], the optimum under each objective with the mean dynamics."""
    expected = np.einsum("ask,oask->oas", model.prob, reward)
    onward = model.prob * ~ends
    values = np.zeros((len(reward), model.enabled.shape[1]))
    possible = model.enabled.any(axis=0)
    for _ in range(horizon):
        of_actions = expected + np.einsum("oask,oask->oas", onward, values[:, model.target])
        values = np.where(possible, np.where(model.enabled, of_actions, IMPOSSIBLE).max(axis=1), 0.0)
    return values
