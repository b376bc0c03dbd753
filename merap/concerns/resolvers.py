"""Hold the resolvers of the three concerns together."""

from __future__ import annotations

from dataclasses import dataclass

from merap.concerns.expression_names import CONCERNS
from merap.concerns.resolve_capability import CapabilityResolver
from merap.concerns.resolve_environment import EnvironmentResolver
from merap.concerns.resolve_objective import ObjectiveResolver
from merap.mdp.short_repr import ShortRepr
from merap.program.form import ConcernName


@dataclass(frozen=True, eq=False, repr=False)
class Resolvers(ShortRepr):
    """The resolver of each concern."""

    environment: EnvironmentResolver
    capability: CapabilityResolver
    objective: ObjectiveResolver

    def names_read(self) -> dict[ConcernName, set[str]]:
        """Return the resolved names of all that the expressions of each concern read."""
        return {concern: getattr(self, concern).names_read() for concern in CONCERNS}
