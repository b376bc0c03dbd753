"""Manage a Gymnasium environment whose observations are whole numbers.

An environment is somebody else's program: it may raise anything, warn, and give undeclared answers.
That is an input error while it is made and a fault of the system (`SystemFault`) from then on.

Axes: A actions, V state variables.
"""

from __future__ import annotations

import logging
import re
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from merap.errors import InputError, MerapError, shortened
from merap.masking import masked, secrets_in
from merap.mdp.gymnasium_env import MDPEnv
from merap.mdp.gymnasium_import import make_environment
from merap.mdp.gymnasium_spaces import changing_wrapper, gymnasium
from merap.mdp.gymnasium_toy_text import names_of, numbered_names
from merap.mdp.model import Bools, Ints
from merap.systems.description import MAX_NAMES, Interface, ShownVariable, is_finite
from merap.systems.gymnasium_numbers import numbers_of, variables_of
from merap.systems.interface import FaultKind, Observation, SystemFault

ACTION_MASK = "action_mask"
MAX_REASON = 500
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
log = logging.getLogger(__name__)


class GymnasiumSystem(AbstractContextManager["GymnasiumSystem"]):
    """An environment as a managed system; to be closed, or used in a `with` statement.

    Environments with a table that `import_gymnasium` knows, and those made of our models, show the
    variables and actions of that model, so a strategy for the model manages them, unless a wrapper
    may have changed observations or actions (see `changing_wrapper`). Others show a variable for each
    number of their observation, named by the key of a `Dict`. Terminated is a
    completed task; truncated is truncated.

    Warnings of the environment are logged, each message once.

    Args:
        env: an environment, or the id of one.
        seed: seed of its first reset, which determines all that follows.
        masked: whether `info["action_mask"]`, if it is there, tells what is enabled; else all actions are.
        arguments: arguments of `gymnasium.make`, if it is an id.

    Raises:
        InputError: there is no such environment, it can't be made, or its observations or actions are no
            whole numbers.
    """

    def __init__(
        self,
        env: str | gymnasium.Env[Any, Any],
        *,
        seed: int | None = None,
        masked: bool = True,
        arguments: Mapping[str, Any] | None = None,
    ) -> None:
        given = arguments or {}
        self._secrets = secrets_in(given)
        self._warned: set[str] = set()
        self._name = env if isinstance(env, str) else type(env).__name__
        self._seed = seed
        self._masked = masked
        self._over = True
        with self._foreign(lambda reason: InputError(f"Gymnasium can't make {self._name!r}: {reason}")):
            self._env = make_environment(env, given) if isinstance(env, str) else env
        try:
            with self._foreign(lambda reason: InputError(f"{self._name} can't be managed: {reason}")):
                spec = self._env.spec
                self._name = type(self._env.unwrapped).__name__ if spec is None else spec.id
                self._view = _view(self._env, self._name)
        except InputError:
            if isinstance(env, str):
                self.close()
            raise
        self._enabled = np.zeros(len(self._view.actions), dtype=np.bool_)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the environment; if it fails to, the log says so."""
        try:
            with self._foreign(lambda reason: self._fault("failed", "close", reason)):
                self._env.close()
        except MerapError as error:
            log.warning("%s", error)

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._view.actions

    @property
    def interface(self) -> Interface:
        """The actions and variables that are shown."""
        return Interface(self._name, self._view.actions, self._view.variables)

    def reset(self) -> Observation:
        """Begin an episode.

        Raises:
            SystemFault: the environment fails, or gives an undeclared answer; it can be reset again.
        """
        self._over = True
        with self._foreign(lambda reason: self._fault("failed", "reset", reason)):
            answer = self._env.reset(seed=self._seed)
        self._seed = None
        with self._foreign(lambda reason: self._fault("malformed", "reset", reason)):
            seen, info = _parts(answer, "observation", "info")
            valuation, self._enabled = self._view.valuation(seen), self._mask(info, last=False)
        self._over = False
        return Observation(valuation, self._enabled, reward=0.0, continuation=1.0, truncated=False)

    def step(self, action: int) -> Observation:
        """Take an action.

        Raises:
            InputError: the action is not enabled, or the episode is over.
            SystemFault: the environment fails, or gives an undeclared answer. It may have acted, so
                the action is not to be taken again.
        """
        if self._over:
            raise InputError("the episode is over; reset the system first")
        if not 0 <= action < len(self.actions) or not self._enabled[action]:
            enabled = ", ".join(np.array(self.actions)[self._enabled])
            raise InputError(f"action {action} is not enabled; enabled are {enabled}")
        with self._foreign(lambda reason: self._fault("failed", "step", reason, repeatable=False)):
            answer = self._env.step(self._view.first_action + action)
        with self._foreign(lambda reason: self._fault("malformed", "step", reason, repeatable=False)):
            return self._observation(answer)

    def _observation(self, answer: Any) -> Observation:
        seen, reward, *ends, info = _parts(answer, "observation", "reward", "terminated", "truncated", "info")
        terminated, truncated = _flag("terminated", ends[0]), _flag("truncated", ends[1])
        self._over = terminated or truncated
        valuation, earned = self._view.valuation(seen), _real(reward)
        self._enabled = np.zeros_like(self._enabled) if terminated else self._mask(info, last=truncated)
        return Observation(
            valuation=valuation,
            enabled=self._enabled,
            reward=earned,
            continuation=0.0 if terminated else 1.0,
            truncated=truncated and not terminated,
        )

    def _mask(self, info: Any, *, last: bool) -> Bools:
        if not isinstance(info, Mapping):
            raise ValueError(f"the info is {info!r}, expected a mapping")
        if not (self._masked and ACTION_MASK in info):
            return np.ones_like(self._enabled)
        mask = np.asarray(info[ACTION_MASK])
        if mask.shape != self._enabled.shape:
            raise ValueError(f"the action mask has shape {mask.shape}, not {self._enabled.shape}")
        if mask.dtype.kind not in "biuf" or not np.isin(mask, (0, 1)).all():
            raise ValueError(f"the action mask is {mask.tolist()}, expected 0 or 1 for each action")
        if not mask.any() and not last:
            raise ValueError("the action mask enables no action, though the episode goes on")
        return mask.astype(np.bool_)

    def _fault(self, kind: FaultKind, call: str, reason: str, *, repeatable: bool = True) -> SystemFault:
        return SystemFault(kind, f"{self._name}: {call}: {reason}", repeatable=repeatable)

    @contextmanager
    def _foreign(self, translated: Callable[[str], MerapError]) -> Iterator[None]:
        """Turn whatever the environment raises into an error of ours."""
        try:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                yield
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except MerapError as error:
            shown = masked(str(error), self._secrets)
            if shown == str(error):
                raise
            raise InputError(shown) from None
        except BaseException as error:  # it may raise what is no Exception, as SystemExit
            raise translated(self._reason(error)) from error
        for warning in told:
            self._warn(str(warning.message))

    def _reason(self, error: BaseException) -> str:
        """Return in one line why something failed, in our words where the check is ours."""
        lines = [str(error)] if type(error) is ValueError else traceback.format_exception_only(error)
        text = masked(" ".join("".join(lines).split()), self._secrets)
        return shortened(text, MAX_REASON)

    def _warn(self, message: str) -> None:
        shown = masked(" ".join(_COLOUR.sub("", message).split()), self._secrets)
        if shown not in self._warned:
            self._warned.add(shown)
            log.warning("%s warns: %s", self._name, shown)


def _parts(answer: Any, *names: str) -> tuple[Any, ...]:
    if not isinstance(answer, tuple) or len(answer) != len(names):
        found = f"{len(answer)} values" if isinstance(answer, tuple) else f"a {type(answer).__name__}"
        raise ValueError(f"the answer is {found}, expected {', '.join(names)}")
    return answer


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} is {value!r}, expected true or false")
    return bool(value)


def _real(reward: Any) -> float:
    """Return a reward that is one finite number."""
    if not is_finite(reward):
        raise ValueError(f"the reward is {reward!r}, expected a finite number")
    return float(reward)


@dataclass(frozen=True, eq=False)
class _View:
    """The names and numbers by which an environment is seen.

    Attributes:
        actions: A names.
        first_action: the environment's number of the first.
        variables: V state variables.
        valuation: valuation of an observation, int64 [V].
    """

    actions: tuple[str, ...]
    first_action: int
    variables: tuple[ShownVariable, ...]
    valuation: Callable[[Any], Ints]


def _view(env: gymnasium.Env[Any, Any], name: str) -> _View:
    if not isinstance(env.action_space, gymnasium.spaces.Discrete):
        raise InputError(f"{name}: its actions are {env.action_space}; a managed system needs Discrete ones")
    count, first = int(env.action_space.n), int(env.action_space.start)
    known = _tabular(env)
    if known is not None:
        variables, table, actions = known
        states = env.observation_space
        return _View(
            actions, first, _variables(variables, table), lambda seen: table[numbers_of(states, seen)[0]]
        )
    if count > MAX_NAMES:
        raise InputError(f"{name}: it has {count} actions, at most {MAX_NAMES} are allowed")
    actions = numbered_names(0, count).action_names
    space = env.observation_space
    return _View(actions, first, variables_of(space, name), lambda seen: numbers_of(space, seen))


def _tabular(env: gymnasium.Env[Any, Any]) -> tuple[tuple[str, ...], Ints, tuple[str, ...]] | None:
    """Return names, valuations [S, V] and actions where an observation is the number of a known state."""
    if not isinstance(env.observation_space, gymnasium.spaces.Discrete) or changing_wrapper(env) is not None:
        return None
    base = env.unwrapped
    if isinstance(base, MDPEnv):
        return base.mdp.variable_names, base.mdp.valuations, base.action_names
    names = names_of(base, to_import=False)
    return None if names is None else (names.variable_names, names.valuations, names.action_names)


def _variables(names: tuple[str, ...], table: Ints) -> tuple[ShownVariable, ...]:
    return tuple(
        ShownVariable(name, int(low), int(high))
        for name, low, high in zip(names, table.min(axis=0), table.max(axis=0), strict=True)
    )
