"""Give records with arrays and long collections a repr that fits on a screen."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from typing import Any

import numpy as np

MAX_LENGTH = 300
MAX_VALUE = 60
MAX_ENTRIES = 4


class ShortRepr:
    """A base of dataclasses that are declared with `repr=False`.

    Their repr has at most `MAX_LENGTH` characters: arrays appear as type and shape, long collections as
    their size, records inside by name.
    """

    def __repr__(self) -> str:
        shown = ", ".join(
            f"{field.name}={_shown(getattr(self, field.name))}"
            for field in fields(self)  # type: ignore[arg-type]
            if field.repr
        )
        return _cut(f"{type(self).__name__}({shown})", MAX_LENGTH)


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{list(value.shape)}"
    if isinstance(value, ShortRepr):
        name = getattr(value, "name", None)
        return f"<{type(value).__name__} {name}>" if isinstance(name, str) else f"<{type(value).__name__}>"
    if isinstance(value, Collection) and not isinstance(value, str) and len(value) > MAX_ENTRIES:
        return f"<{len(value)} entries>"
    return _cut(repr(value), MAX_VALUE)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 4]}...{text[-1]}"
