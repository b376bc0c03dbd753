"""Any Gymnasium environment whose observations are whole numbers, as a managed system.

Axes: A actions, V state variables.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from merap.closing import Closing
from merap.errors import InputError
from merap.mdp.canonical import ABSORBING_VALUE
from merap.mdp.gymnasium_env import MDPEnv
from merap.mdp.gymnasium_import import make_environment
from merap.mdp.gymnasium_spaces import changing_wrapper, gymnasium
from merap.mdp.gymnasium_toy_text import names_of, numbered_names
from merap.mdp.model import Bools, Ints
from merap.systems.description import Interface, Variable
from merap.systems.interface import Observation

ACTION_MASK = "action_mask"


class GymnasiumSystem(Closing):
    """An environment as a managed system; to be closed, or used in a `with` statement.

    Environments with a table that `import_gymnasium` knows, and those made of our models, show the
    variables and actions of that model, so a strategy for the model manages them, unless a wrapper
    may have changed observations or actions (see `changing_wrapper`). Others show a variable for each
    number of their observation, named by the key of a `Dict`. Terminated is a
    completed task, whose variables are -1; truncated is truncated.

    Args:
        env: an environment, or the id of one.
        seed: of its first reset, which determines all that follows.
        masked: whether `info["action_mask"]`, if it is there, tells what is enabled; else all actions are.
        arguments: of `gymnasium.make`, if it is an id.

    Raises:
        InputError: there is no such environment, or its observations or actions are no whole numbers.
    """

    def __init__(
        self,
        env: str | gymnasium.Env[Any, Any],
        *,
        seed: int | None = None,
        masked: bool = True,
        arguments: Mapping[str, Any] | None = None,
    ) -> None:
        self._env = make_environment(env, arguments or {}) if isinstance(env, str) else env
        spec = self._env.spec
        self._name = type(self._env.unwrapped).__name__ if spec is None else spec.id
        self._view = _view(self._env, self._name)
        self._seed = seed
        self._masked = masked
        self._over = True
        self._enabled = np.zeros(len(self._view.actions), dtype=np.bool_)

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._view.actions

    @property
    def interface(self) -> Interface:
        """How it is served."""
        return Interface(self._name, self._view.actions, self._view.variables)

    def reset(self) -> Observation:
        """Begin an episode."""
        seen, info = self._env.reset(seed=self._seed)
        self._seed = None
        return self._observe(seen, info, 0.0)

    def step(self, action: int) -> Observation:
        """Take an action."""
        if self._over:
            raise InputError("the episode is over; reset the system first")
        if not 0 <= action < len(self.actions) or not self._enabled[action]:
            enabled = ", ".join(np.array(self.actions)[self._enabled])
            raise InputError(f"action {action} is not enabled; enabled are {enabled}")
        seen, reward, terminated, truncated, info = self._env.step(self._view.first_action + action)
        return self._observe(seen, info, float(reward), terminated=terminated, truncated=truncated)

    def _observe(
        self,
        seen: Any,
        info: Mapping[str, Any],
        reward: float,
        *,
        terminated: bool = False,
        truncated: bool = False,
    ) -> Observation:
        self._over = bool(terminated or truncated)
        self._enabled = np.zeros_like(self._enabled) if terminated else self._mask(info)
        completed = np.full(len(self._view.variables), ABSORBING_VALUE)
        return Observation(
            valuation=completed if terminated else self._view.valuation(seen),
            enabled=self._enabled,
            reward=reward,
            continuation=0.0 if terminated else 1.0,
            truncated=bool(truncated and not terminated),
        )

    def _mask(self, info: Mapping[str, Any]) -> Bools:
        if not (self._masked and ACTION_MASK in info):
            return np.ones_like(self._enabled)
        mask = np.asarray(info[ACTION_MASK]).astype(np.bool_)
        if mask.shape != self._enabled.shape:
            raise InputError(
                f"{self._name}: the action mask has shape {mask.shape}, not {self._enabled.shape}"
            )
        return mask


@dataclass(frozen=True, eq=False)
class _View:
    """How an environment is seen.

    Attributes:
        actions: A names.
        first_action: the environment's number of the first.
        variables: V state variables.
        valuation: of an observation, int64 [V].
    """

    actions: tuple[str, ...]
    first_action: int
    variables: tuple[Variable, ...]
    valuation: Callable[[Any], Ints]


def _view(env: gymnasium.Env[Any, Any], name: str) -> _View:
    if not isinstance(env.action_space, gymnasium.spaces.Discrete):
        raise InputError(f"{name}: its actions are {env.action_space}; a managed system needs Discrete ones")
    count, first = int(env.action_space.n), int(env.action_space.start)
    known = _tabular(env)
    if known is not None:
        variables, table, actions = known
        return _View(actions, first, _variables(variables, table), lambda seen: table[int(seen)])
    actions = numbered_names(0, count).action_names
    space = env.observation_space
    own = _numbers("state" if isinstance(space, gymnasium.spaces.Discrete) else "", space, name)
    return _View(actions, first, own, lambda seen: np.array(_flat(space, seen), dtype=np.int64))


def _tabular(env: gymnasium.Env[Any, Any]) -> tuple[tuple[str, ...], Ints, tuple[str, ...]] | None:
    """Names, valuations [S, V] and actions, where an observation is the number of a state we know."""
    if not isinstance(env.observation_space, gymnasium.spaces.Discrete) or changing_wrapper(env) is not None:
        return None
    base = env.unwrapped
    if isinstance(base, MDPEnv):
        return base.mdp.variable_names, base.mdp.valuations, base.action_names
    names = names_of(base, to_import=False)
    return None if names is None else (names.variable_names, names.valuations, names.action_names)


def _variables(names: tuple[str, ...], table: Ints) -> tuple[Variable, ...]:
    return tuple(
        Variable(name, ABSORBING_VALUE, int(high))
        for name, high in zip(names, table.max(axis=0), strict=True)
    )


def _numbers(prefix: str, space: gymnasium.Space[Any], env: str) -> tuple[Variable, ...]:
    """The variables of a space, in the order of `_flat`."""
    spaces = gymnasium.spaces
    if isinstance(space, spaces.Discrete):
        return (_variable(prefix, int(space.start), int(space.start + space.n) - 1),)
    if isinstance(space, spaces.Dict | spaces.Tuple):
        parts = space.spaces.items() if isinstance(space, spaces.Dict) else enumerate(space.spaces)
        return tuple(chain.from_iterable(_numbers(_joined(prefix, key), part, env) for key, part in parts))
    low, high = _bounds(space, env)
    return tuple(
        _variable(_joined(prefix, index), int(least), int(greatest))
        for index, (least, greatest) in enumerate(zip(low.ravel(), high.ravel(), strict=True))
    )


def _variable(name: str, low: int, high: int) -> Variable:
    return Variable(name, min(low, ABSORBING_VALUE), high)


def _joined(prefix: str, key: object) -> str:
    name = key if isinstance(key, str) else f"x{key}"
    return f"{prefix}_{name}" if prefix else name


def _bounds(space: gymnasium.Space[Any], env: str) -> tuple[Ints, Ints]:
    spaces = gymnasium.spaces
    if isinstance(space, spaces.MultiDiscrete):
        return np.asarray(space.start), np.asarray(space.start + space.nvec - 1)
    if isinstance(space, spaces.MultiBinary):
        return np.zeros(space.shape, dtype=np.int64), np.ones(space.shape, dtype=np.int64)
    if isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.integer):
        return space.low.astype(np.int64), space.high.astype(np.int64)
    raise InputError(
        f"{env}: {space} is no space of whole numbers; allowed: Discrete, MultiDiscrete, MultiBinary, "
        "Box of whole numbers, and Dict or Tuple of these"
    )


def _flat(space: gymnasium.Space[Any], seen: Any) -> list[int]:
    """The numbers of an observation; those of a `Dict` in the order of its space, not of the observation."""
    spaces = gymnasium.spaces
    if isinstance(space, spaces.Dict):
        return list(chain.from_iterable(_flat(part, seen[key]) for key, part in space.spaces.items()))
    if isinstance(space, spaces.Tuple):
        pairs = zip(space.spaces, seen, strict=True)
        return list(chain.from_iterable(_flat(part, entry) for part, entry in pairs))
    return [int(value) for value in np.asarray(seen).ravel()]
