"""The errors merap raises on purpose; everything else is a defect."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import ClassVar

from merap.masking import masked


class MerapError(Exception):
    """Something the caller can mend; `str(error)` is one clear line, without secrets (`merap.masking`).

    `exit_code` is what the command line returns for it.
    """

    exit_code: ClassVar[int] = 2

    def __init__(self, message: str) -> None:
        super().__init__(masked(message))


class MerapWarning(UserWarning):
    """Warn of something that is allowed but probably not meant, when merap is used from Python."""


def warn_of(lines: Iterable[str]) -> None:
    """Warn a caller from Python, two calls above."""
    for line in lines:
        warnings.warn(line, MerapWarning, stacklevel=3)


class InputError(MerapError):
    """A file, key or argument is wrong.

    Args:
        message: the offending value and what is allowed.
        source: the file it stands in.
        line: its line there, counted from 1.
        key: the path of keys to it, as `space.edges[3]`.
    """

    def __init__(
        self,
        message: str,
        *,
        source: str | None = None,
        line: int | None = None,
        key: str | None = None,
    ) -> None:
        self.message = masked(" ".join(message.split()))
        self.source = source
        self.line = line
        self.key = key
        place = f"{source}:{line}" if source and line is not None else source
        text = ": ".join(part for part in (place, key, self.message) if part)
        super().__init__(" ".join(text.splitlines()))


class OutputError(MerapError):
    """A result can't be written without losing something that is there."""


class ModelError(MerapError):
    """A model violates an invariant; the message names state and action."""


class EngineError(MerapError):
    """A model checker failed or can't answer."""

    exit_code: ClassVar[int] = 3


class StorageError(MerapError):
    """The knowledge base can't be reached, read or written; what was committed is still there."""

    exit_code: ClassVar[int] = 3


def shortened(text: str, most: int) -> str:
    """Return a text for messages, of at most that many characters and a mark where it is cut."""
    return text if len(text) <= most else f"{text[:most]} ..."


def listed(names: Sequence[str], most: int) -> str:
    """Return names for messages, at most that many, and the number of the others."""
    others = len(names) - most
    return ", ".join(names[:most]) + (f" and {others} more" if others > 0 else "")


def quoted_if_odd(name: str) -> str:
    """Return a name for messages, quoted and escaped if a character of it can't be printed."""
    return name if name.isprintable() else repr(name)
