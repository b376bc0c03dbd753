"""Close configurations: put in what their expressions read of the other concerns' parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from merap.concerns.combination import Capability, Configuration, DeclaredObjective, Environment
from merap.concerns.document import Document, KeyPath
from merap.concerns.expression_names import CONCERNS
from merap.concerns.resolution_context import names_in
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import Constants, Expression, fold
from merap.program.form import ConcernName

# A configuration of a concern that has expressions.
Part = TypeVar("Part", Environment, Capability, DeclaredObjective)
# Closed configurations that are remembered.
CAPACITY = 10_000


def with_values(document: Document, part: Part, values: Constants, whose: str) -> Part:
    """Put values of parameters into the expressions of a configuration, and check how processes begin.

    Args:
        document: the case file.
        part: the configuration.
        values: by resolved names; other names stay.
        whose: the configurations that they belong to, for messages.

    Raises:
        InputError: an expression is undefined, or an initial value not allowed; with its place.
    """

    def put_in(path: KeyPath, expression: Expression) -> Expression:
        with document.told(path, whose):
            return fold(expression, values)

    found = part.mapped(put_in)
    for process in found.processes:
        with document.told(process.path, whose):
            process.check_start()
    return found


def names_in_part(part: Environment | Capability | DeclaredObjective) -> set[str]:
    """Return the names of the variables in the expressions of a configuration, without primes."""
    found: list[Expression] = []

    def note(_: KeyPath, expression: Expression) -> Expression:
        found.append(expression)
        return expression

    part.mapped(note)
    return names_in(found)


@dataclass(frozen=True, eq=False, repr=False)
class Closing(ShortRepr):
    """Closes configurations; those that read nothing of another concern stay the same objects.

    Attributes:
        document: the case file, for messages.
        foreign: the resolved names of parameters of other concerns that each concern reads.
    """

    document: Document
    foreign: Mapping[ConcernName, frozenset[str]]
    _closed: dict[tuple[Any, ...], Configuration] = field(default_factory=dict)

    def pair(self, environment: Environment, capability: Capability) -> tuple[Environment, Capability]:
        """Close an environment and a capability, which read nothing of an objective.

        Raises:
            InputError: an expression is undefined, or an initial value not allowed.
        """
        return (
            self._close("environment", environment, [capability]),
            self._close("capability", capability, [environment]),
        )

    def objective(
        self, objective: DeclaredObjective, environment: Environment, capability: Capability
    ) -> DeclaredObjective:
        """Close an objective for an environment and a capability.

        Raises:
            InputError: an expression is undefined, or an initial value not allowed.
        """
        return self._close("objective", objective, [environment, capability])

    def seen_by_capability(self, environment: Environment) -> tuple[Any, ...]:
        """Return a key that is the same for environments with the same attributes and parameters read."""
        read = sorted(self.foreign["capability"])
        return id(environment.attributes), *(environment.known.get(name) for name in read)

    def _close(self, concern: ConcernName, part: Part, others: Sequence[Configuration]) -> Part:
        names = self.foreign[concern]
        if not names:
            return part
        values: Constants = {
            name: value for other in others for name, value in other.known.items() if name in names
        }
        key = (part, *(values[name] for name in sorted(values)))
        if key not in self._closed:
            if len(self._closed) >= CAPACITY:
                self._closed.pop(next(iter(self._closed)))
            whose = f"{concern} {part.name} with {' and '.join(other.name for other in others)}"
            self._closed[key] = with_values(self.document, part, values, whose)
        return self._closed[key]  # type: ignore[return-value]


def foreign_names(read: Mapping[ConcernName, set[str]]) -> dict[ConcernName, frozenset[str]]:
    """Return which parameters of other concerns each concern reads.

    Args:
        read: the resolved names of all that the expressions of a concern read.
    """
    return {
        concern: frozenset(
            name for name in read[concern] if "." in name and not name.startswith(f"{concern}.")
        )
        for concern in CONCERNS
    }
