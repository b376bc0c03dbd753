"""Close configurations: put in what their expressions read of the other concerns' parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from merap.concerns.combination import (
    Capability,
    Condition,
    Configuration,
    DeclaredObjective,
    Environment,
    RewardRule,
)
from merap.concerns.expression_names import CONCERNS
from merap.concerns.external_action import ExternalAction
from merap.concerns.innate import Innate
from merap.concerns.processes import DeclaredProcess
from merap.errors import InputError
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import FALSE, ZERO, Constants, Expression, fold
from merap.program.form import ConcernName

Change = Callable[[Expression], Expression]
Part = TypeVar("Part", bound=Configuration)
# Closed configurations that are remembered.
CAPACITY = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class Closing(ShortRepr):
    """Closes configurations; those that read nothing of another concern stay the same objects.

    Attributes:
        source: the case file, for messages.
        foreign: the resolved names of parameters of other concerns that each concern reads.
    """

    source: str
    foreign: Mapping[ConcernName, frozenset[str]]
    _closed: dict[tuple[Any, ...], Configuration] = field(default_factory=dict)

    def pair(self, environment: Environment, capability: Capability) -> tuple[Environment, Capability]:
        """Close an environment and a capability, which read nothing of an objective.

        Raises:
            InputError: an expression is undefined, or an initial value not allowed.
        """
        return (
            self._close("environment", environment, _environment, [capability]),
            self._close("capability", capability, _capability, [environment]),
        )

    def objective(
        self, objective: DeclaredObjective, environment: Environment, capability: Capability
    ) -> DeclaredObjective:
        """Close an objective for an environment and a capability.

        Raises:
            InputError: an expression is undefined, or an initial value not allowed.
        """
        return self._close("objective", objective, _objective, [environment, capability])

    def seen_by_capability(self, environment: Environment) -> tuple[Any, ...]:
        """Return a key that is the same for environments with the same attributes and parameters read."""
        read = sorted(self.foreign["capability"])
        return id(environment.attributes), *(environment.known.get(name) for name in read)

    def _close(
        self,
        concern: ConcernName,
        part: Part,
        mapped: Callable[[Any, Change], Any],
        others: Iterable[Configuration],
    ) -> Part:
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
            try:
                self._closed[key] = mapped(part, lambda expression: fold(expression, values))
            except InputError as error:
                known = " and ".join(other.name for other in others)
                message = f"{error.message} ({concern} {part.name} with {known})"
                raise InputError(message, source=self.source) from error
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


def possible(actions: Iterable[ExternalAction]) -> Iterator[ExternalAction]:
    """Leave out actions that are never enabled, and outcomes of probability 0.

    The first outcome says what is intended, so it stays even if it is impossible.
    """
    for action in actions:
        if action.requires != FALSE:
            likely = (one for one in action.outcomes[1:] if one.probability != ZERO)
            yield replace(action, outcomes=(action.outcomes[0], *likely))


def _processes(processes: Iterable[DeclaredProcess], change: Change) -> tuple[DeclaredProcess, ...]:
    closed = tuple(process.mapped(change) for process in processes)
    for process in closed:
        try:
            process.check_start()
        except InputError as error:
            raise InputError(f"process {process.name}: {error.message}") from error
    return closed


def _environment(environment: Environment, change: Change) -> Environment:
    return replace(environment, processes=_processes(environment.processes, change))


def _capability(capability: Capability, change: Change) -> Capability:
    actions = (action.mapped(change) for action in capability.external)
    return replace(
        capability,
        external=tuple(possible(actions)),
        innate=_innate(capability.innate, change),
        processes=_processes(capability.processes, change),
    )


def _innate(innate: Innate | None, change: Change) -> Innate | None:
    """Close an automaton; it is lacking where it requires what never holds."""
    requires = FALSE if innate is None else change(innate.requires)
    return None if innate is None or requires == FALSE else replace(innate, requires=requires)


def _objective(objective: DeclaredObjective, change: Change) -> DeclaredObjective:
    def condition(given: Condition | None) -> Condition | None:
        if given is None or given.where is None:
            return given
        return replace(given, where=change(given.where))

    return replace(
        objective,
        rules=tuple(
            RewardRule(condition(rule.condition) or rule.condition, change(rule.value))
            for rule in objective.rules
        ),
        ends_after=condition(objective.ends_after),
        ends_in=condition(objective.ends_in),
        goal=condition(objective.goal),
        unsafe=condition(objective.unsafe),
        labels={name: change(where) for name, where in objective.labels.items()},
        processes=_processes(objective.processes, change),
    )
