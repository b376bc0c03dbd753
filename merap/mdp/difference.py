"""Measure how much two models of a case differ: `eq:diff` of the paper.

The equation sums over all (s, a, s'). A choice that a model does not have counts as T = 0 and
r = 0, and so does a successor of probability 0. Both terms are then squared Euclidean distances
of vectors over the choices of either model, and 0 means that the models are the same.

Rewards per branch are compared where all models at hand have them. Where one has only expected
rewards, as all models from Storm do, r(s, a) is compared instead, once for each (s, a); the two
kinds of numbers must not be mixed in one ranking.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from merap.errors import ModelError
from merap.mdp.model import Floats, Ints, TabularMDP


@dataclass(frozen=True)
class Difference:
    """The value of `eq:diff` for two models, and its terms.

    Attributes:
        total: w1 * transition + w2 * reward.
        transition: sum of (T_R(s, a, s') - T_i(s, a, s'))^2.
        reward: sum of (r_R - r_i)^2 over (s, a, s'), or over (s, a).
        per_branch: whether the rewards compared are those of (s, a, s').
    """

    total: float
    transition: float
    reward: float
    per_branch: bool


def model_difference(system: TabularMDP, model: TabularMDP, w1: float = 1.0, w2: float = 1.0) -> Difference:
    """Return the difference of one model from the system.

    Args:
        system: M_R, on the canonical index of a case.
        model: M_i, on the same index.
        w1: weight of the transition term.
        w2: weight of the reward term.

    Raises:
        ModelError: the models are not on one index.
    """
    per_branch = system.branch_reward is not None and model.branch_reward is not None
    return _difference(system, model, w1, w2, per_branch=per_branch)


def differences(
    system: TabularMDP, models: Mapping[str, TabularMDP], w1: float = 1.0, w2: float = 1.0
) -> dict[str, Difference]:
    """Return the difference of each model from the system, all with the same kind of reward.

    Args:
        system: M_R, on the canonical index of a case.
        models: name -> M_i, on the same index.
        w1: weight of the transition term.
        w2: weight of the reward term.

    Raises:
        ModelError: the models are not on one index.
    """
    per_branch = all(one.branch_reward is not None for one in (system, *models.values()))
    return {name: _difference(system, model, w1, w2, per_branch=per_branch) for name, model in models.items()}


def nearest(
    system: TabularMDP, models: Mapping[str, TabularMDP], w1: float = 1.0, w2: float = 1.0
) -> tuple[str, Difference]:
    """Find the model that differs least from the system, the minimum in `eq:diff`.

    Args:
        system: M_R, on the canonical index of a case.
        models: name -> M_i, at least one; of equally near ones the first.
        w1: weight of the transition term.
        w2: weight of the reward term.

    Raises:
        ModelError: the models are not on one index.
    """
    of_models = differences(system, models, w1, w2)
    name = min(of_models, key=lambda candidate: of_models[candidate].total)
    return name, of_models[name]


def _difference(
    system: TabularMDP, model: TabularMDP, w1: float, w2: float, *, per_branch: bool
) -> Difference:
    _check_one_index(system, model)
    transition = _squared_distance(
        (_branch_keys(system), system.branch_prob), (_branch_keys(model), model.branch_prob)
    )
    if per_branch and system.branch_reward is not None and model.branch_reward is not None:
        reward = _squared_distance(
            (_branch_keys(system), system.branch_reward), (_branch_keys(model), model.branch_reward)
        )
    else:
        reward = _squared_distance(
            (_choice_keys(system), system.choice_reward), (_choice_keys(model), model.choice_reward)
        )
    return Difference(w1 * transition + w2 * reward, transition, reward, per_branch)


def _check_one_index(system: TabularMDP, model: TabularMDP) -> None:
    for name in ("variable_names", "action_names"):
        if getattr(system, name) != getattr(model, name):
            raise ModelError(
                f"the models are not on one index: {name} are {', '.join(getattr(system, name))} "
                f"and {', '.join(getattr(model, name))}"
            )
    if not np.array_equal(system.valuations, model.valuations):
        raise ModelError("the models are not on one index: their states differ")


def _choice_keys(mdp: TabularMDP) -> Ints:
    """Return int64 [C], one number per (s, a)."""
    return mdp.choice_state * mdp.num_actions + mdp.choice_action


def _branch_keys(mdp: TabularMDP) -> Ints:
    """Return int64 [B], one number per (s, a, s')."""
    return _choice_keys(mdp)[mdp.branch_choice] * mdp.num_states + mdp.branch_target


def _squared_distance(one: tuple[Ints, Floats], other: tuple[Ints, Floats]) -> float:
    """Return the squared distance of two sparse vectors, each given by distinct keys and their values."""
    keys = np.concatenate((one[0], other[0]))
    values = np.concatenate((one[1], -other[1]))
    order = np.argsort(keys)
    deviation = np.add.reduceat(values[order], np.flatnonzero(np.diff(keys[order], prepend=-1)))
    return float(deviation @ deviation)
