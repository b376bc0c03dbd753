"""Arguments as users write them in Python: text for a path, a number for seeds; else one clear error."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from merap.concerns.schema_base import shown
from merap.errors import InputError

Instance = TypeVar("Instance")

SEED_LIMIT = 2**63


def as_path(value: str | PathLike[str], argument: str) -> Path:
    """Return a path.

    Raises:
        InputError: it is neither text nor a path.
    """
    if not isinstance(value, str | PathLike):
        raise InputError(f"expected a path, got {shown(value)}", source=argument)
    return Path(value)


def as_text(value: str, argument: str) -> str:
    """Return text as it is.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(value, str):
        raise InputError(f"expected a name, got {shown(value)}", source=argument)
    return value


def as_number(value: Any, argument: str) -> float:
    """Return a real number, of Python's or NumPy's types.

    Raises:
        InputError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"expected a number, got {shown(value)}", source=argument)
    try:
        return float(value)
    except OverflowError as error:
        raise InputError(f"{shown(value)} is too large for a number", source=argument) from error


def as_instance(value: Instance, kind: type[Instance], argument: str) -> Instance:
    """Return a value as it is.

    Raises:
        InputError: it is of another kind.
    """
    if not isinstance(value, kind):
        raise InputError(f"expected {kind.__name__}, got {shown(value)}", source=argument)
    return value


def as_mapping(value: Mapping[str, Any], argument: str) -> Mapping[str, Any]:
    """Return a mapping as it is.

    Raises:
        InputError: it is something else, or a key is no text.
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"expected a mapping of names to values, got {shown(value)}", source=argument)
    return value


def as_seeds(value: int | str | Iterable[int], argument: str = "seeds") -> Sequence[int]:
    """Return seeds: one, several, or those of a text such as `0:5`.

    Raises:
        InputError: one is no whole number from 0 to 2^63 - 1, or there is none.
    """
    given = value
    if isinstance(value, str):
        value = _range(value, argument)
    found: Sequence[int] = (
        value
        if isinstance(value, range)  # which may be long
        else tuple(as_count(seed, argument, least=0) for seed in _several(value))
    )
    if not found:
        raise InputError(f"there is no seed in {shown(given)}", source=argument)
    extremes = (found[0], found[-1]) if isinstance(found, range) else found
    if min(extremes) < 0 or max(extremes) >= SEED_LIMIT:
        raise InputError(f"seeds must be from 0 to {SEED_LIMIT - 1}, got {shown(given)}", source=argument)
    return found


def _several(value: int | Iterable[int]) -> Iterable[int]:
    return value if isinstance(value, Iterable) else (value,)


def _range(text: str, argument: str) -> range:
    first, colon, end = text.partition(":")
    ascii_digits = (first + end).isascii() and first.isdecimal() and (end.isdecimal() if colon else not end)
    if not ascii_digits or len(text) > len(str(SEED_LIMIT)) * 2 + 1:
        raise InputError(f"expected a:b with whole numbers or one seed, got {text!r}", source=argument)
    return range(int(first), int(end) if colon else int(first) + 1)


def as_count(value: Any, argument: str, least: int = 1) -> int:
    """Return a whole number, of Python's or NumPy's types.

    Raises:
        InputError: it is none, or too small.
    """
    try:
        count = operator.index(value)
    except TypeError:
        count = least - 1
    if isinstance(value, bool) or count < least:
        raise InputError(f"expected a whole number of at least {least}, got {shown(value)}", source=argument)
    return count
