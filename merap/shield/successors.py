"""Where an action of a belief's tables leads, and what that risks by itself.

Axes as in `belief.actions`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from merap.belief.actions import ActionTable
from merap.belief.space import HypothesisSpace
from merap.mdp.model import Bools, Floats, Ints
from merap.shield.outcomes import Rows, rows

Number = TypeVar("Number", np.int64, np.float64)


@dataclass(frozen=True, eq=False)
class Successors:
    """Of one action.

    Attributes:
        action: its index.
        num_actions: A.
        target: int64 [S, K], on the canonical index.
        risk: float64 [S, K].
    """

    action: int
    num_actions: int
    target: Ints
    risk: Floats

    def rows(self, state: Ints, prob: Floats) -> Rows:
        """Distributions float64 [R, K] in states int64 [R]."""
        choice = state * self.num_actions + self.action
        return rows(choice, self.target[state], prob, self.risk[state])


def successors(
    space: HypothesisSpace, action: int, ends: Bools, avoided: Bools, hazards: Floats
) -> Successors:
    """Where an action leads.

    Args:
        space: the hypotheses.
        action: its index.
        ends: bool [S, at least K], the step surely completes the task.
        avoided: bool [S], the unsafe states.
        hazards: float64 [P].
    """
    table: ActionTable = space.actions[action]
    ended = ends[:, : table.target.shape[1]]
    here = np.arange(space.num_states)[:, np.newaxis] // space.num_modes
    there = table.target // space.num_modes
    entered = np.where(there != here, hazards[there], 0.0)
    return Successors(
        action=action,
        num_actions=len(space.actions),
        target=np.where(ended, space.num_states, table.target),
        risk=np.where(ended & avoided[table.target], 1.0, entered),
    )


def joined(parts: Sequence[Rows]) -> Rows:
    """All rows as one, padded to the widest."""
    width = max(part.target.shape[1] for part in parts)

    def padded(column: npt.NDArray[Number]) -> npt.NDArray[Number]:
        wide = np.zeros((len(column), width), dtype=column.dtype)
        wide[:, : column.shape[1]] = column
        return wide

    return Rows(
        choice=np.concatenate([part.choice for part in parts]),
        target=np.concatenate([padded(part.target) for part in parts]),
        prob=np.concatenate([padded(part.prob) for part in parts]),
        risk=np.concatenate([padded(part.risk) for part in parts]),
    )
