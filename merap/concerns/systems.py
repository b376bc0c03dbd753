"""Read the systems that are met online from the case file or a scenario."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, Self

from merap.concerns.checks import DistributionCheck, check_system_start
from merap.concerns.closing import Closing
from merap.concerns.combination import (
    Capability,
    Combination,
    DeclaredCombination,
    DeclaredObjective,
    Environment,
    ResetMode,
)
from merap.concerns.configurations import read_values
from merap.concerns.document import Document, KeyPath
from merap.concerns.parameters import Values
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolvers import Resolvers
from merap.concerns.schema import SystemSpec
from merap.concerns.supports import Support, Supports
from merap.mdp.short_repr import ShortRepr
from merap.program.form import ConcernName
from merap.program.names import suggestion


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SystemReader(ShortRepr, ABC):
    """Makes online systems; values that equal a configuration take its name.

    Attributes:
        context: of the case; its document is where errors are placed.
        supports: of the case.
        declared: the systems that the case file declares, by name.
        discount: of the case.
        digest: hexadecimal SHA-256 of the sources.
        place: where the document describes the system; None: at `online.<name>`.
    """

    context: ResolutionContext
    supports: Supports[Any, Any, Any]
    declared: Mapping[str, SystemSpec]
    discount: float
    digest: str
    place: KeyPath | None = None

    def placed(self, document: Document, place: KeyPath) -> Self:
        """The same for a system that another document describes."""
        return replace(self, context=replace(self.context, document=document), place=place)

    def _path(self, name: str) -> KeyPath:
        return ("online", name) if self.place is None else self.place

    @abstractmethod
    def __call__(self, name: str, spec: SystemSpec) -> Combination:
        """The online system called `name`.

        Raises:
            InputError: a configuration, parameter or location is unknown, or the start is closed.
        """

    def _check_name(self, name: str) -> None:
        """A configuration of the same name would be mistaken for the system's own one."""
        supports: tuple[Support[Any], ...] = (
            self.supports.environment,
            self.supports.capability,
            self.supports.objective,
        )
        if any(support.index(name) is not None for support in supports):
            raise self.context.document.error(
                self._path(name), f"duplicate name {name!r}: a configuration is called so too"
            )

    def _concern(self, system: str, concern: ConcernName, spec: SystemSpec) -> Any:
        """Return the configuration that a system has of a concern."""
        support: Support[Any] = getattr(self.supports, concern)
        found = self._find(system, concern, support, getattr(spec, concern))
        return support[found] if isinstance(found, int) else support.resolve(system, found)

    def _find(
        self, system: str, concern: ConcernName, support: Support[Any], given: str | Mapping[str, Any] | None
    ) -> int | Values:
        """The index of the configuration, or values that no configuration has."""
        path = (*self._path(system), concern)
        if given is None:
            if support.count == 1:
                return 0
            raise self.context.document.error(
                path, f"key {concern!r} is missing, and {concern} has {support.count} configurations"
            )
        if isinstance(given, str):
            index = support.index(given)
            if index is None:
                near = suggestion(given, islice(support.names(), 1000))
                raise self.context.document.error(path, f"unknown configuration {given!r} of {concern}{near}")
            return index
        values = read_values(self.context, path, self.context.parameters[concern], given)
        index = support.index_of(values)
        return values if index is None else index


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DeclaredSystemReader(SystemReader):
    """Makes the online systems of a case in the case language.

    Attributes:
        resolvers: of the case.
        closing: puts in what a configuration reads of the others.
        check_pair: refuses an environment and a capability that don't fit together.
    """

    resolvers: Resolvers
    closing: Closing
    check_pair: DistributionCheck

    def __call__(self, name: str, spec: SystemSpec) -> DeclaredCombination:
        """See `SystemReader`."""
        self._check_name(name)
        system = self.combined(
            self._concern(name, "environment", spec),
            self._concern(name, "capability", spec),
            self._objective(name, spec),
            name=name,
            reset=spec.reset,
        )
        check_system_start(self.context, self._path(name), system)
        return system

    def combined(
        self,
        environment: Environment,
        capability: Capability,
        objective: DeclaredObjective,
        *,
        name: str | None = None,
        reset: ResetMode = "episodes",
    ) -> DeclaredCombination:
        """Return the combination of three configurations.

        Args:
            environment: its environment.
            capability: its capability.
            objective: its objective.
            name: of a system; None: the combination is called as the three are.
            reset: how an episode after the first begins.

        Raises:
            InputError: an expression is undefined, or the three do not fit together.
        """
        pair = self.closing.pair(environment, capability)
        objective = self.closing.objective(objective, *pair)
        self.check_pair(*pair)
        return DeclaredCombination(
            name=name or ".".join(part.name for part in (*pair, objective)),
            space=self.context.space,
            modes=self.context.modes,
            actions=self.context.actions,
            environment=pair[0],
            capability=pair[1],
            objective=objective,
            discount=self.discount,
            digest=self.digest,
            reset=reset,
        )

    def _objective(self, system: str, spec: SystemSpec) -> DeclaredObjective:
        support = self.supports.objective
        found = self._find(system, "objective", support, spec.objective)
        name, values = system, found
        if isinstance(found, int):
            name, values = support.name(found), support.configurations.values(found)
        assert not isinstance(values, int)
        start = None if spec.start is None else ((*self._path(system), "start"), spec.start)
        return self.resolvers.objective(name, values, start, spec.horizon)
