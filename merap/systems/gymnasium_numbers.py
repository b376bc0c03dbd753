"""Take the whole numbers of an observation by its Gymnasium space, as values of state variables.

Nothing is rounded, cut or wrapped to fit: an observation that its space does not allow is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

import numpy as np

from merap.errors import InputError, shortened
from merap.mdp.gymnasium_spaces import gymnasium
from merap.mdp.model import Ints
from merap.systems.description import MAX_NAMES, ShownVariable

spaces = gymnasium.spaces

MAX_SHOWN = 80


def variables_of(space: gymnasium.Space[Any], env: str) -> tuple[ShownVariable, ...]:
    """Return a variable for each number of a space, in the order of `numbers_of`.

    Args:
        space: space of observations.
        env: the environment's name, for errors.

    Raises:
        InputError: it is no space of whole numbers, or has too many of them.
    """
    count = sum(leaf.size for leaf in _leaves(space, env))
    if count > MAX_NAMES:
        raise InputError(f"{env}: an observation has {count} numbers, at most {MAX_NAMES} are allowed")
    return tuple(_variables("state" if isinstance(space, spaces.Discrete) else "", space, env))


def numbers_of(space: gymnasium.Space[Any], seen: Any) -> Ints:
    """Return the numbers of an observation, int64 [V]; those of a `Dict` in the order of its space.

    Raises:
        ValueError: the space does not allow it: another type or shape, or a value out of range.
    """
    return np.array(list(_numbers("", space, seen)), dtype=np.int64)


def _variables(prefix: str, space: gymnasium.Space[Any], env: str) -> Iterator[ShownVariable]:
    if isinstance(space, spaces.Dict | spaces.Tuple):
        for key, part in _parts(space):
            yield from _variables(_joined(prefix, key), part, env)
        return
    low, high = _bounds(space, env)
    for index, (least, greatest) in enumerate(zip(low.ravel(), high.ravel(), strict=True)):
        name = prefix if isinstance(space, spaces.Discrete) else _joined(prefix, index)
        yield ShownVariable(name, int(least), int(greatest))


def _numbers(place: str, space: gymnasium.Space[Any], seen: Any) -> Iterator[int]:
    if not isinstance(space, spaces.Dict | spaces.Tuple):
        yield from _whole_numbers(place, space, seen)
        return
    parts = dict(_parts(space))
    if isinstance(space, spaces.Dict):
        fits = isinstance(seen, Mapping) and set(seen) == set(parts)
    else:
        fits = isinstance(seen, tuple | list) and len(seen) == len(parts)
    if not fits:
        expected = ", ".join(map(str, parts))
        raise ValueError(f"the observation{place} is {_shown(seen)}, expected the parts {expected}")
    for key, part in parts.items():
        yield from _numbers(f"{place}[{key!r}]", part, seen[key])


def _whole_numbers(place: str, space: gymnasium.Space[Any], seen: Any) -> list[int]:
    low, high = _bounds(space, "")
    values = np.asarray(seen)
    if values.dtype != np.bool_ and not np.issubdtype(values.dtype, np.integer):
        raise ValueError(f"the observation{place} is {_shown(seen)}, expected whole numbers of {space}")
    if values.shape != low.shape:
        raise ValueError(f"the observation{place} has the shape {values.shape}, expected that of {space}")
    if not ((values >= low) & (values <= high)).all():
        raise ValueError(f"the observation{place} is {_shown(seen)}, which is out of {space}")
    return [int(value) for value in values.ravel()]


def _leaves(space: gymnasium.Space[Any], env: str) -> Iterator[Ints]:
    """Yield the lower bounds of every part of a space that has no parts itself."""
    if isinstance(space, spaces.Dict | spaces.Tuple):
        yield from chain.from_iterable(_leaves(part, env) for _, part in _parts(space))
    else:
        yield _bounds(space, env)[0]


def _parts(
    space: gymnasium.spaces.Dict | gymnasium.spaces.Tuple[Any],
) -> Iterator[tuple[Any, gymnasium.Space[Any]]]:
    yield from space.spaces.items() if isinstance(space, spaces.Dict) else enumerate(space.spaces)


def _joined(prefix: str, key: object) -> str:
    name = key if isinstance(key, str) else f"x{key}"
    return f"{prefix}_{name}" if prefix else name


def _bounds(space: gymnasium.Space[Any], env: str) -> tuple[Ints, Ints]:
    """Return the least and the greatest value of each number, int64 in the shape of an observation."""
    if isinstance(space, spaces.Discrete):
        low, high = np.asarray(space.start), np.asarray(space.start + space.n - 1)
    elif isinstance(space, spaces.MultiDiscrete):
        low, high = np.asarray(space.start), np.asarray(space.start + space.nvec - 1)
    elif isinstance(space, spaces.MultiBinary):
        low, high = np.zeros(space.shape, dtype=np.int64), np.ones(space.shape, dtype=np.int64)
    elif isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.integer):
        low, high = space.low, space.high
    else:
        raise InputError(
            f"{env}: {space} is no space of whole numbers; allowed: Discrete, MultiDiscrete, MultiBinary, "
            "Box of whole numbers, and Dict or Tuple of these"
        )
    if high.size and high.max() > np.iinfo(np.int64).max:
        raise InputError(f"{env}: {space} has values beyond 64 bits with a sign")
    return low.astype(np.int64), high.astype(np.int64)


def _shown(seen: Any) -> str:
    return shortened(" ".join(repr(seen).split()), MAX_SHOWN)
