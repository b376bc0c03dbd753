"""Assemble an MDP from a list of branches, and merge its branches.

Axes as in `model.py`: S states, C choices, B branches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from merap.mdp.csr import pointers_of
from merap.mdp.graph import reachable_along
from merap.mdp.matching import first_repeat
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
    reachable: Bools | None = None,
) -> TabularMDP:
    """Sort, merge and index branches into an MDP.

    Branches that agree in state, action and target become one: probabilities add up, the
    reward is their mean weighted by probability. The other arguments are those of
    `TabularMDP`, whose `reachable` is computed where it is not known.

    Raises:
        ModelError: from `TabularMDP`.
    """
    merged = _merge(branches, len(initial), len(action_names))
    first = np.flatnonzero(_changes(merged.state) | _changes(merged.action))
    choice_to_branch = np.append(first, len(merged.state))
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
        reachable=reachable_along(merged.state, merged.target, initial > 0)
        if reachable is None
        else reachable,
        labels=labels,
        valuations=valuations,
        variable_names=variable_names,
        action_names=action_names,
    )


def _merge(branches: Branches, num_states: int, num_actions: int) -> Branches:
    key = branches.state * num_actions
    key += branches.action
    key *= num_states
    key += branches.target
    order = np.argsort(key, kind="stable")
    if not branches.prob.all():
        order = order[branches.prob[order] != 0]
    is_first = _changes(key[order])
    first = order[is_first]
    prob, reward = branches.prob[first], branches.reward[first]
    reward *= prob
    repeats = np.flatnonzero(~is_first)
    if len(repeats):
        group = np.searchsorted(np.flatnonzero(is_first), repeats) - 1
        more = branches.prob[order[repeats]]
        np.add.at(prob, group, more)
        np.add.at(reward, group, more * branches.reward[order[repeats]])
    reward /= prob
    return Branches(branches.state[first], branches.action[first], branches.target[first], prob, reward)


def _changes(values: Ints) -> Bools:
    """bool [M], where a value differs from the one before it; the first one does."""
    found = np.ones(len(values), dtype=np.bool_)
    np.not_equal(values[1:], values[:-1], out=found[1:])
    return found


def merge_branches(
    choice_to_branch: Ints, target: Ints, prob: Floats, reward: Floats | None, num_states: int
) -> tuple[Ints, Ints, Floats, Floats | None]:
    """Drop branches of probability 0 and merge those of one choice to one state.

    Probabilities add up, rewards become their mean weighted by probability, and a merged branch
    stands where the first one stood. Arrays that need no change are returned as they are, and so
    are those with a negative probability, which `TabularMDP` refuses.

    Args:
        choice_to_branch: int64 [C + 1], pointers.
        target: int64 [B], in 0..num_states - 1.
        prob: float64 [B].
        reward: float64 [B] or None.
        num_states: S.

    Returns:
        The four arrays with the branches that remain.
    """
    keep = np.flatnonzero(prob)
    if not np.all(prob >= 0):
        return choice_to_branch, target, prob, reward
    num_choices = len(choice_to_branch) - 1
    choice = np.repeat(np.arange(num_choices), np.diff(choice_to_branch))  # [B]
    key = choice * num_states + target
    if len(keep) == len(prob) and first_repeat(key) is None:
        return choice_to_branch, target, prob, reward
    _, first, inverse = np.unique(key[keep], return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    merged = place[inverse]  # where each kept branch goes
    remaining = keep[first[order]]
    total = sum_by(merged, prob[keep], len(order))
    mean = None
    if reward is not None:
        earned = sum_by(merged, (prob * reward)[keep], len(order))
        alone = np.bincount(merged, minlength=len(order)) == 1
        mean = np.where(alone, reward[remaining], earned / total)
    pointers = pointers_of(np.bincount(choice[remaining], minlength=num_choices))
    return pointers, target[remaining], total, mean


def sum_by(group: Ints, values: Floats, size: int) -> Floats:
    """Return float64 [size], the sum of `values` over each `group`."""
    return np.bincount(group, values, minlength=size).astype(np.float64, copy=False)
