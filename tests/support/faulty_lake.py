"""A FrozenLake that misbehaves as its arguments say; importing this registers `FaultyLake-v0`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv

Answer = tuple[Any, ...]


class Abort(BaseException):
    """What no Exception is, as programs in other languages raise it."""


class SpeechlessError(Exception):
    """Can't say what it is."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


def _raising(error: BaseException) -> Callable[[Answer], Answer]:
    def change(answer: Answer) -> Answer:
        raise error

    return change


# What a call answers or raises in place of (observation, reward, terminated, truncated, info).
RAISED: Mapping[str, Callable[[Answer], Answer]] = {
    "raises": _raising(RuntimeError("the motor is\nhot")),
    "raises a key": _raising(KeyError(3)),
    "asserts": _raising(AssertionError()),
    "exits": _raising(SystemExit("enough")),
    "aborts": _raising(Abort("panic")),
    "says nothing": _raising(SpeechlessError()),
}
OBSERVED: Mapping[str, Any] = {
    "too high": 16,
    "below": -1,
    "half": 2.5,
    "whole but real": 2.0,
    "text": "3",
    "missing": None,
    "in a list": [3],
    "in an array": np.array([3]),
    "not a number": float("nan"),
    "beyond 64 bits": 10**30,
}
REWARDS: Mapping[str, Any] = {
    "array": np.array([1.0]),
    "two": np.array([1.0, 2.0]),
    "array without shape": np.array(1.0),
    "list": [1.0],
    "not a number": float("nan"),
    "infinite": float("inf"),
    "missing": None,
    "text": "1",
    "complex": 1j,
    "beyond all": 10**400,
}
FLAGS: Mapping[str, Any] = {"1": 1, "0": 0, "none": None, "array": np.array([False]), "text": "no"}
INFOS: Mapping[str, Any] = {
    "none": None,
    "list": [],
    "short mask": {"action_mask": np.ones(3, dtype=np.int8)},
    "deep mask": {"action_mask": np.ones((4, 1), dtype=np.int8)},
    "mask of twos": {"action_mask": np.full(4, 2, dtype=np.int8)},
    "mask of halves": {"action_mask": np.full(4, 0.5)},
    "mask of text": {"action_mask": ["yes"] * 4},
    "mask of nothing": {"action_mask": np.zeros(4, dtype=np.int8)},
    "no mask": {"action_mask": None},
}
SHAPES: Mapping[str, Callable[[Answer], Any]] = {
    "nothing": lambda answer: None,
    "one less": lambda answer: answer[:-1],
    "one more": lambda answer: (*answer, {}),
}


def changed(fault: str, answer: Answer) -> Any:
    """What is answered in place of (observation, info) or the five of a step."""
    kind, _, name = fault.partition(": ")
    if kind == "raised":
        return RAISED[name](answer)
    if kind == "shape":
        return SHAPES[name](answer)
    if kind == "warns":
        warnings.warn("the ice is thin", stacklevel=2)
        return answer
    values = {"observation": OBSERVED, "reward": REWARDS, "info": INFOS}.get(kind, FLAGS)
    places = {"observation": 0, "reward": 1, "terminated": 2, "truncated": 3, "info": -1}
    parts = list(answer)
    parts[places[kind]] = values[name]
    return tuple(parts)


FAULTS = tuple(
    f"{kind}: {name}"
    for kind, names in (
        ("raised", RAISED),
        ("observation", OBSERVED),
        ("reward", REWARDS),
        ("terminated", FLAGS),
        ("truncated", FLAGS),
        ("info", INFOS),
        ("shape", SHAPES),
    )
    for name in names
)


class FaultyLake(FrozenLakeEnv):
    """FrozenLake with a fault.

    Args:
        fault: one of FAULTS, or `warns: `.
        call: in which: `make`, `reset`, `step` or `close`.
        calls: the numbers of the calls in which it happens, counted from 0.
    """

    def __init__(
        self, fault: str = "", call: str = "step", calls: tuple[int, ...] = (2,), **more: Any
    ) -> None:
        self.fault, self.call, self.calls = fault, call, calls
        self.count = 0
        super().__init__(**more)
        self._answer("make", ())

    def reset(self, **given: Any) -> Any:
        return self._answer("reset", super().reset(**given))

    def step(self, action: Any) -> Any:
        step: Any = super().step
        return self._answer("step", step(action))

    def close(self) -> None:
        self._answer("close", ())
        close: Any = super().close
        close()

    def _answer(self, call: str, answer: Answer) -> Any:
        if call != self.call:
            return answer
        self.count += 1
        return changed(self.fault, answer) if self.fault and self.count - 1 in self.calls else answer


def register() -> str:
    """Register the lake without the wrappers that look at answers; return its id."""
    if "FaultyLake-v0" not in gymnasium.registry:
        gymnasium.register(
            "FaultyLake-v0", entry_point=FaultyLake, disable_env_checker=True, max_episode_steps=100
        )
    return "FaultyLake-v0"


register()
