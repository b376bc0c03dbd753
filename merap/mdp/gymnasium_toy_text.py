"""What the table `P` of Gymnasium's toy_text environments doesn't tell: factors, names, labels.

Sources: the documentation of Gymnasium 1.4, Toy Text.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from merap.errors import InputError
from merap.mdp.gymnasium_extra import gymnasium, toy_text
from merap.mdp.model import Bools, Ints


@dataclass(frozen=True, eq=False)
class TableNames:
    """How states and actions of a table are called.

    Attributes:
        variable_names: V names.
        valuations: int64 [S, V], distinct rows, none of them -1 throughout.
        action_names: A names; an action is its number in the table.
        labels: name -> bool [S].
    """

    variable_names: tuple[str, ...]
    valuations: Ints
    action_names: tuple[str, ...]
    labels: Mapping[str, Bools]


def names_of(env: gymnasium.Env[Any, Any], *, to_import: bool = True) -> TableNames | None:
    """The names of a known environment, None of any other.

    Args:
        env: unwrapped.
        to_import: whether its table is to be read.

    Raises:
        InputError: the table is to be read, and the environment does what it doesn't tell.
    """
    if isinstance(env, toy_text.FrozenLakeEnv):
        return _frozen_lake(env)
    if isinstance(env, toy_text.CliffWalkingEnv):
        return _cliff_walking(env)
    if isinstance(env, toy_text.TaxiEnv):
        return _taxi(env, to_import=to_import)
    return None


def numbered_names(num_states: int, num_actions: int) -> TableNames:
    """The variable `state` and actions `a0`, `a1`, ..."""
    actions = tuple(f"a{action}" for action in range(num_actions))
    return TableNames(("state",), np.arange(num_states)[:, np.newaxis], actions, {})


def _frozen_lake(env: toy_text.FrozenLakeEnv) -> TableNames:
    tiles = np.asarray(env.desc).ravel()
    return TableNames(
        ("row", "col"),
        _cells((env.nrow, env.ncol)),
        ("left", "down", "right", "up"),
        {"goal": tiles == b"G", "hole": tiles == b"H"},
    )


def _cliff_walking(env: toy_text.CliffWalkingEnv) -> TableNames:
    cells = _cells(env.shape)
    row, col = cells.T
    bottom, right = env.shape[0] - 1, env.shape[1] - 1
    labels = {
        "goal": (row == bottom) & (col == right),
        "cliff": (row == bottom) & (col > 0) & (col < right),
    }
    return TableNames(("row", "col"), cells, ("up", "right", "down", "left"), labels)


def _taxi(env: toy_text.TaxiEnv, *, to_import: bool) -> TableNames:
    if to_import and env.fickle_passenger:
        raise InputError(
            "Taxi with fickle_passenger=True can't be imported: its table P doesn't tell when the passenger "
            "changes the destination"
        )
    valuations = _cells((5, 5, 5, 4))
    destination = valuations[:, 3]
    arrived = (valuations[:, :2] == np.array(env.locs)[destination]).all(axis=1)
    return TableNames(
        ("taxi_row", "taxi_col", "passenger", "destination"),
        valuations,
        ("south", "north", "east", "west", "pickup", "dropoff"),
        {"goal": arrived & (valuations[:, 2] == destination)},
    )


def _cells(shape: tuple[int, ...]) -> Ints:
    """int64 [product of the shape, dimensions], the indices of all cells in C order."""
    return np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)
