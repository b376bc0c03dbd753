"""Name the states and actions of Gymnasium's toy_text environments, which their table `P` only numbers.

Sources: the documentation of Gymnasium 1.4, Toy Text.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from merap.errors import InputError
from merap.mdp.gymnasium_spaces import gymnasium, toy_text
from merap.mdp.model import Bools, Ints


@dataclass(frozen=True, eq=False)
class TableNames:
    """Names for the states and actions of a table.

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
    """Return the names of a known environment, None for any other.

    Args:
        env: unwrapped; its spaces must be those that belong to the names.
        to_import: whether its table is to be read.

    Raises:
        InputError: the table is to be read, and the environment does things that it leaves out.
    """
    names = _known_names(env, to_import=to_import)
    if names is None:
        return None
    sizes = len(names.valuations), len(names.action_names)
    expected = tuple(gymnasium.spaces.Discrete(size) for size in sizes)
    return names if (env.observation_space, env.action_space) == expected else None


def _known_names(env: gymnasium.Env[Any, Any], *, to_import: bool) -> TableNames | None:
    if isinstance(env, toy_text.FrozenLakeEnv):
        return _frozen_lake(env)
    if isinstance(env, toy_text.CliffWalkingEnv):
        return _cliff_walking(env)
    if isinstance(env, toy_text.TaxiEnv):
        return _taxi(env, to_import=to_import)
    return None


def numbered_names(num_states: int, num_actions: int, first_state: int = 0) -> TableNames:
    """Return the variable `state`, counted from its first value, and actions `a0`, `a1`, ..."""
    actions = tuple(f"a{action}" for action in range(num_actions))
    return TableNames(("state",), first_state + np.arange(num_states)[:, np.newaxis], actions, {})


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
    """Return int64 [product of the shape, dimensions], the indices of all cells in C order."""
    return np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)
