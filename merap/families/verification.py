"""Verify what a caller gives: a case or its path, one combination or several."""

from __future__ import annotations

from collections.abc import Iterator

from merap.checker import verdicts
from merap.checker.properties import TIMEOUT
from merap.checker.verdicts import Verdict
from merap.families.lookup import Combinations, as_combinations


def verify(
    combinations: Combinations, only: str | None = None, *, timeout: float = TIMEOUT
) -> Iterator[Verdict]:
    """Render, build and check combinations with Storm, in a process of its own.

    Args:
        combinations: a case or the path of its file, one combination or several.
        only: the name of one property, for the combinations that have it; all by default.
        timeout: seconds for building a model, and for each property.

    Raises:
        InputError: no property has that name, or one can't be parsed; no such timeout.
        ModelError: a model is unsound.
        EngineError: Storm failed.
    """
    yield from verdicts.verify(as_combinations(combinations), only, timeout=timeout)
