"""The branches of a model on the index of its family.

Axes: S states of the index, S' of the model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from merap.mdp.csr import pointers_of
from merap.mdp.model import Floats, Ints, TabularMDP


def placed_branches(
    model: TabularMDP, choices: Ints, order: Ints, row: Ints, ends: Ints, size: int
) -> dict[str, Any]:
    """Return pointers and branches of a model on an index, as fields of `TabularMDP`.

    Args:
        model: the model.
        choices: int64, its choices that are kept.
        order: int64, of these choices and of `end` in each completed state behind them.
        row: int64 [S'], the number of each state on the index.
        ends: int64, the numbers of the completed states.
        size: S.
    """
    position = np.empty(len(order), dtype=np.int64)
    position[order] = np.arange(len(order))
    place = np.full(model.num_choices, -1)
    place[choices] = position[: len(choices)]
    branches = np.flatnonzero(place[model.branch_choice] >= 0)
    key = np.concatenate(
        [
            place[model.branch_choice[branches]] * size + row[model.branch_target[branches]],
            position[len(choices) :] * size + ends,
        ]
    )
    sorting = np.argsort(key, kind="stable")
    key = key[sorting]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    prob = np.concatenate([model.branch_prob[branches], np.ones(len(ends))])[sorting]
    total = _sums(prob, first)
    arrays = {
        "choice_to_branch": pointers_of(np.bincount(key[first] // size, minlength=len(order))),
        "branch_target": key[first] % size,
        "branch_prob": total,
    }
    if model.branch_reward is not None:
        reward = np.concatenate([model.branch_reward[branches], np.zeros(len(ends))])[sorting]
        alone = np.diff(first, append=len(key)) == 1
        arrays["branch_reward"] = np.where(alone, reward[first], _sums(prob * reward, first) / total)
    return arrays


def _sums(values: Floats, first: Ints) -> Floats:
    """Sum the runs of `values` that begin at `first`."""
    sums: Floats = np.add.reduceat(values, first) if len(first) else np.zeros(0)
    return sums
