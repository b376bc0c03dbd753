"""What Gymnasium sees of a model: its observations and their space.

Axes: S states, V variables.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from merap.errors import InputError
from merap.mdp.gymnasium_extra import gymnasium
from merap.mdp.model import TabularMDP

ObservationKind = Literal["state", "factored", "box"]


def observation_table(mdp: TabularMDP, kind: ObservationKind) -> npt.NDArray[Any]:
    """What is observed in each state.

    Args:
        mdp: the model.
        kind: `state`, its number; `factored`, the values of its variables; `box`, the same
            as real numbers, for libraries that know no `MultiDiscrete`.

    Returns:
        int64 [S], int64 [S, V] or float32 [S, V].

    Raises:
        InputError: there is no such kind.
    """
    if kind == "state":
        return np.arange(mdp.num_states)
    if kind == "factored":
        return mdp.valuations
    if kind == "box":
        return mdp.valuations.astype(np.float32)
    raise InputError(f"there is no observation {kind!r}, only {', '.join(get_args(ObservationKind))}")


def observation_space(table: npt.NDArray[Any]) -> gymnasium.Space[Any]:
    """The space of the rows of an observation table.

    Args:
        table: from `observation_table`.

    Returns:
        `Discrete(S)`, a `MultiDiscrete` over the V ranges or a `Box` with these bounds.
    """
    if table.ndim == 1:
        return gymnasium.spaces.Discrete(len(table))
    low, high = table.min(axis=0), table.max(axis=0)
    if table.dtype == np.float32:
        return gymnasium.spaces.Box(low, high, dtype=np.float32)
    return gymnasium.spaces.MultiDiscrete(high - low + 1, dtype=np.int64, start=low)


def check_horizon(horizon: int | None) -> None:
    """Raises InputError unless the horizon is a positive number of steps or None."""
    if horizon is not None and horizon < 1:
        raise InputError(f"the horizon must be at least 1 step, it is {horizon}")
