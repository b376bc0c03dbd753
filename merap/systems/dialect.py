"""Translate between observations and the JSON of a system behind HTTP.

Axes: A declared actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from jsonschema import Draft202012Validator

from merap.errors import shortened
from merap.systems.description import Json
from merap.systems.interface import Observation

MAX_SHOWN = 200


@dataclass(frozen=True, eq=False)
class MonitoredState:
    """The content of a monitored body.

    Attributes:
        observation: as strategies see it; its reward is that of the last step.
        action: index of the last step's action; None: unknown, or a reset.
        episode: number of resets; None: the system does not count.
        step: steps of this episode; None: it does not count.
    """

    observation: Observation
    action: int | None = None
    episode: int | None = None
    step: int | None = None


class Dialect(Protocol):
    """The meaning of the JSON of one kind of system.

    `ServedDialect` is that of `merap serve`; for a foreign system write one of your own.
    """

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""

    def read(self, monitored: Mapping[str, Any]) -> MonitoredState:
        """Read the body of `/monitor`.

        Raises:
            ValueError: the body can't be used.
        """

    def change(self, action: int | None, last: MonitoredState | None) -> Json | None:
        """Build the body of `/execute`; None: nothing is to be sent, as where a system can't be reset.

        Args:
            action: the action to take; None: begin an episode.
            last: the state for which that was decided; None: none was seen yet.
        """


def first_misfit(validator: Draft202012Validator, content: Any) -> str | None:
    """Return where, and how, content first breaks a schema; None: it does not."""
    error = next(iter(validator.iter_errors(content)), None)
    if error is None:
        return None
    return "".join(f" at {key!r}" for key in error.path) + f": {shortened(error.message, MAX_SHOWN)}"
