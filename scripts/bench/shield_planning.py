"""Plans for the models of a base within what a shield leaves, made when a robot first needs one.

Axes: B robots, N models, G sets of credible models, P pairs of a model and such a set, and T, S, A.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.planning import backward_induction
from merap.shield.fixpoint import Risk, robust_risk
from merap.shield.models import model_sets
from merap.shield.policy import planning_mask, slack_mask

# What a planned step costs that the shield would not allow: more than any task is worth.
FORBIDDEN = -1e6


@dataclass(frozen=True, eq=False)
class Guide:
    """What each robot goes by in an episode.

    Attributes:
        risk: of all sets of credible models one after the other: state s under set g has number
            g * S + s; None: there is no shield.
        group: int64 [B], the set of each robot.
        plan: int64 [2, P, T, S], actions of the best plan within the threshold and, for a budget that
            is spent, of the best among the least risky; -1 where there is none.
        chosen: int64 [B], the plan of each robot.
    """

    risk: Risk | None
    group: Ints
    plan: Ints
    chosen: Ints


class Plans:
    """Makes guides; keeps what it has solved.

    Args:
        models: N.
        threshold: lambda; None: no shield.
        horizon: T.
    """

    def __init__(self, models: Sequence[TabularMDP], threshold: float | None, horizon: int) -> None:
        self._models, self._threshold, self._horizon = models, threshold, horizon
        self._sets = None if threshold is None else model_sets(models)
        self._risks: dict[bytes, Risk] = {}
        self._plans: dict[tuple[int, bytes], Ints] = {}

    def guide(self, credible: Bools, drawn: Ints) -> Guide:
        """Make the guide of each robot.

        Args:
            credible: bool [B, N], the models that are credible to each robot.
            drawn: int64 [B], the model it plans for.
        """
        kinds, group = np.unique(credible, axis=0, return_inverse=True)
        if self._sets is None:
            kinds, group = np.ones_like(kinds[:1]), np.zeros_like(group)
        group = group.reshape(-1)
        pairs, chosen = np.unique(group * len(self._models) + drawn, return_inverse=True)
        plans = [self._plan(int(pair) % len(self._models), kinds[int(pair) // len(self._models)])
                 for pair in pairs]  # fmt: skip
        risk = None if self._sets is None else _stacked([self._risk(kind) for kind in kinds])
        return Guide(risk, group, np.stack(plans, axis=1), chosen.reshape(-1))

    def _risk(self, credible: Bools) -> Risk:
        key = credible.tobytes()
        if key not in self._risks:
            assert self._sets is not None
            self._risks[key] = robust_risk(self._sets.outcomes(credible))
        return self._risks[key]

    def _plan(self, number: int, credible: Bools) -> Ints:
        """Return int64 [2, T, S], the plan of one pair."""
        key = number, credible.tobytes()
        if key not in self._plans:
            model = self._models[number]
            masks = [np.ones(model.enabled.shape, dtype=np.bool_)] * 2
            if self._threshold is not None:
                risk = self._risk(credible)
                masks = [planning_mask(risk, self._threshold), slack_mask(risk, 0.0)]
            self._plans[key] = np.stack([_best(model, mask, self._horizon) for mask in masks])
        return self._plans[key]


def _best(model: TabularMDP, mask: Bools, horizon: int) -> Ints:
    """Return int64 [T, S], the best actions within bool [S, A]; others cost too much, but for `end`."""
    widened = np.pad(mask, ((0, 0), (0, model.num_actions - mask.shape[1])), constant_values=True)
    allowed = widened[model.choice_state, model.choice_action]
    reward: Floats = np.where(allowed, model.choice_reward, FORBIDDEN)
    return backward_induction(replace(model, choice_reward=reward, branch_reward=None), horizon).actions


def _stacked(risks: Sequence[Risk]) -> Risk:
    return Risk(
        of_states=np.concatenate([risk.of_states for risk in risks]),
        of_actions=np.concatenate([risk.of_actions for risk in risks]),
        certain=np.concatenate([risk.certain for risk in risks]),
        unsafe=np.concatenate([risk.unsafe for risk in risks]),
        residual=max(risk.residual for risk in risks),
    )
