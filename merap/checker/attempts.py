"""Ask an engine for an answer, and say why there is none."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any, Literal, NamedTuple

from merap.checker.exchange import Answer
from merap.checker.process import OverTimeError
from merap.checker.storm_messages import UnsupportedPropertyError

Status = Literal["ok", "unsupported", "timeout"]


class Attempt(NamedTuple):
    """An answer, empty where there is none, with its status and the reason why there is none."""

    answer: Answer
    status: Status = "ok"
    reason: str | None = None


def attempt(ask: Callable[[], Answer]) -> Attempt:
    """Return the answer; a property that can't be answered, or not in time, is no error."""
    try:
        return Attempt(ask())
    except UnsupportedPropertyError as error:
        return Attempt(Answer(), "unsupported", str(error))
    except OverTimeError as error:
        return Attempt(Answer(), "timeout", str(error))


def for_json(value: Any) -> Any:
    """Return a value as JSON can hold it, which has no infinity: `inf` is a string."""
    return str(value) if isinstance(value, float) and not isfinite(value) else value
