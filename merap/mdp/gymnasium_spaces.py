"""Import Gymnasium, an optional extra; build the spaces of a model; find wrappers that change states.

The other modules take Gymnasium from here, so that one message tells that it is missing.
Axes: S states, V variables.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from merap.errors import InputError
from merap.mdp.model import TabularMDP

try:
    import gymnasium
    from gymnasium import wrappers
    from gymnasium.envs import toy_text
except ModuleNotFoundError as error:
    raise InputError("this needs Gymnasium, which is missing: pip install 'merap[gymnasium]'") from error

__all__ = [
    "ObservationKind",
    "changing_wrapper",
    "check_horizon",
    "gymnasium",
    "observation_space",
    "observation_table",
    "toy_text",
]

ObservationKind = Literal["state", "factored", "box"]

# Wrappers whose `step` and `reset` pass actions and observations on as they are. A class that
# inherits these two functions passes them on as well, whatever else it does.
_KEEPING = (
    gymnasium.Wrapper,
    gymnasium.RewardWrapper,
    wrappers.Autoreset,
    wrappers.HumanRendering,
    wrappers.NormalizeReward,
    wrappers.OrderEnforcing,
    wrappers.PassiveEnvChecker,
    wrappers.RecordEpisodeStatistics,
    wrappers.RecordVideo,
    wrappers.RenderCollection,
    wrappers.TimeLimit,
)
_KEEPING_STEPS = frozenset(wrapper.step for wrapper in _KEEPING)
_KEEPING_RESETS = frozenset(wrapper.reset for wrapper in _KEEPING)


def changing_wrapper(env: gymnasium.Env[Any, Any]) -> str | None:
    """Return the class of a wrapper that may change observations or actions, None without one.

    Where there is one, states and actions are known by `env.observation_space` and
    `env.action_space` alone: the tables and names of `env.unwrapped` are about other numbers.
    Equal spaces do not show that nothing is changed, since a wrapper may permute the numbers.
    So each wrapper must be known to pass them on; rewards and limits of steps may change.
    """
    layer = env
    while isinstance(layer, gymnasium.Wrapper):
        kind = type(layer)
        if kind.step not in _KEEPING_STEPS or kind.reset not in _KEEPING_RESETS or not _keeps_spaces(layer):
            return kind.__name__
        layer = layer.env
    return None


def _keeps_spaces(wrapper: gymnasium.Wrapper[Any, Any, Any, Any]) -> bool:
    spaces = ("observation_space", "action_space")
    return all(getattr(wrapper, name, None) == getattr(wrapper.env, name, None) for name in spaces)


def observation_table(mdp: TabularMDP, kind: ObservationKind) -> npt.NDArray[Any]:
    """Build the table of the observations of all states.

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
    """Return the space that holds the rows of an observation table.

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
    """Raise InputError unless the horizon is a positive number of steps or None."""
    if horizon is not None and horizon < 1:
        raise InputError(f"the horizon must be at least 1 step, it is {horizon}")
