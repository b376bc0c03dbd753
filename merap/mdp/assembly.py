"""Assemble an MDP from a list of branches, and take a part of one out.

Axes as in `model.py`: S states, C choices, B branches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from merap.mdp.graph import reachable_along
from merap.mdp.model import Bools, Floats, Ints, TabularMDP


@dataclass(frozen=True, eq=False)
class Branches:
    """Branches in any order; equal (state, action, target) may occur repeatedly.

    Attributes:
        state: int64 [B].
        action: int64 [B].
        target: int64 [B].
        prob: float64 [B]; a probability of 0 is dropped.
        reward: float64 [B], r(s, a, s').
    """

    state: Ints
    action: Ints
    target: Ints
    prob: Floats
    reward: Floats


def assemble(
    branches: Branches,
    *,
    initial: Floats,
    labels: Mapping[str, Bools],
    valuations: Ints,
    variable_names: tuple[str, ...],
    action_names: tuple[str, ...],
) -> TabularMDP:
    """Sort, merge and index branches into an MDP.

    Branches that agree in state, action and target become one: probabilities add up, the
    reward is their mean weighted by probability. The other arguments are those of
    `TabularMDP`, whose `reachable` is computed.

    Raises:
        ModelError: from `TabularMDP`.
    """
    merged = _merge(branches, len(initial), len(action_names))
    choice_key = merged.state * len(action_names) + merged.action
    first = np.flatnonzero(np.diff(choice_key, prepend=-1))
    choice_to_branch = np.append(first, len(choice_key))
    choice_state = merged.state[first]
    state_to_choice = np.searchsorted(choice_state, np.arange(len(initial) + 1))
    choice_of_branch = np.repeat(np.arange(len(first)), np.diff(choice_to_branch))
    return TabularMDP(
        state_to_choice=state_to_choice,
        choice_to_branch=choice_to_branch,
        branch_target=merged.target,
        branch_prob=merged.prob,
        choice_action=merged.action[first],
        choice_reward=sum_by(choice_of_branch, merged.prob * merged.reward, len(first)),
        branch_reward=merged.reward,
        initial=initial,
        reachable=reachable_along(merged.state, merged.target, initial > 0),
        labels=labels,
        valuations=valuations,
        variable_names=variable_names,
        action_names=action_names,
    )


def _merge(branches: Branches, num_states: int, num_actions: int) -> Branches:
    keep = branches.prob != 0
    key = (branches.state * num_actions + branches.action) * num_states + branches.target
    unique, inverse = np.unique(key[keep], return_inverse=True)
    prob = sum_by(inverse, branches.prob[keep], len(unique))
    earned = sum_by(inverse, (branches.prob * branches.reward)[keep], len(unique))
    choice, target = np.divmod(unique, num_states)
    state, action = np.divmod(choice, num_actions)
    return Branches(state, action, target, prob, earned / prob)


def sum_by(group: Ints, values: Floats, size: int) -> Floats:
    """float64 [size]: the sum of `values` over each `group`."""
    return np.bincount(group, values, minlength=size).astype(np.float64, copy=False)
