"""What the JSON of a system behind HTTP means.

Axes: A declared actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from merap.systems.description import Json
from merap.systems.interface import Observation


@dataclass(frozen=True, eq=False)
class Seen:
    """What a monitor says.

    Attributes:
        observation: as strategies see it; its reward is that of the last step.
        action: index of what the last step has done; None: unknown, or a reset.
        episode: number of resets; None: the system does not count.
        step: steps of this episode; None: it does not count.
    """

    observation: Observation
    action: int | None = None
    episode: int | None = None
    step: int | None = None


class Dialect(Protocol):
    """How one kind of system speaks: what its JSON means.

    `ServedDialect` is that of `merap serve`; for a foreign system write one of your own.
    """

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""

    def read(self, monitored: Mapping[str, Any]) -> Seen:
        """What the body of `/monitor` means.

        Raises:
            ValueError: nothing that can be used.
        """

    def change(self, action: int | None, last: Seen | None) -> Json | None:
        """The body of `/execute`; None: nothing is to be sent, as where a system can't be reset.

        Args:
            action: what to do; None: begin an episode.
            last: what was seen when that was decided; None: nothing yet.
        """
