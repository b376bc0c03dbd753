"""Read the systems that are met online from the case file or a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, TypeVar

from merap.concerns.checks import DistributionCheck, check_system_start
from merap.concerns.closing import Closing
from merap.concerns.combination import DeclaredCombination, DeclaredObjective
from merap.concerns.configurations import read_values
from merap.concerns.document import Document, KeyPath
from merap.concerns.parameters import ParameterTypes, Values
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolvers import Resolvers
from merap.concerns.schema import CaseSpec, SystemSpec
from merap.concerns.supports import DeclaredSupports, Support
from merap.mdp.short_repr import ShortRepr
from merap.program.names import suggestion

Resolved = TypeVar("Resolved")


@dataclass(frozen=True, eq=False, repr=False)
class SystemReader(ShortRepr):
    """Makes online systems; values that equal a configuration take its name.

    Attributes:
        context: of the case; its document is where errors are placed.
        spec: of the case.
        supports: of the case.
        resolvers: of the case.
        closing: puts in what a configuration reads of the others.
        check_pair: refuses an environment and a capability that don't fit together.
        digest: hexadecimal SHA-256 of the sources.
        place: where the document describes the system; None: at `online.<name>`.
    """

    context: ResolutionContext
    spec: CaseSpec
    supports: DeclaredSupports
    resolvers: Resolvers
    closing: Closing
    check_pair: DistributionCheck
    digest: str
    place: KeyPath | None = None

    def placed(self, document: Document, place: KeyPath) -> SystemReader:
        """The same for a system that another document describes."""
        return replace(self, context=replace(self.context, document=document), place=place)

    def _path(self, name: str) -> KeyPath:
        return ("online", name) if self.place is None else self.place

    def __call__(self, name: str, spec: SystemSpec) -> DeclaredCombination:
        """The online system called `name`.

        Raises:
            InputError: a configuration, parameter or location is unknown, or the start is closed.
        """
        self._check_name(name)
        path = self._path(name)
        environment, capability = self.closing.pair(
            self._concern(name, "environment", self.supports.environment, spec.environment),
            self._concern(name, "capability", self.supports.capability, spec.capability),
        )
        objective = self.closing.objective(self._objective(name, spec), environment, capability)
        system = DeclaredCombination(
            name=name,
            space=self.context.space,
            modes=self.context.modes,
            actions=self.context.actions,
            environment=environment,
            capability=capability,
            objective=objective,
            discount=self.spec.discount,
            digest=self.digest,
            reset=spec.reset,
        )
        self.check_pair(environment, capability)
        check_system_start(self.context, path, system)
        return system

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

    def _concern(
        self, system: str, concern: str, support: Support[Resolved], given: str | Mapping[str, Any] | None
    ) -> Resolved:
        found = self._find(system, concern, support, given)
        return support[found] if isinstance(found, int) else support.resolve(system, found)

    def _objective(self, system: str, spec: SystemSpec) -> DeclaredObjective:
        support = self.supports.objective
        found = self._find(system, "objective", support, spec.objective)
        name, values = system, found
        if isinstance(found, int):
            name, values = support.name(found), support.configurations.values(found)
        assert not isinstance(values, int)
        start = None if spec.start is None else ((*self._path(system), "start"), spec.start)
        return self.resolvers.objective(name, values, start, spec.horizon)

    def _find(
        self, system: str, concern: str, support: Support[Any], given: str | Mapping[str, Any] | None
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
        types: ParameterTypes = getattr(self.spec, concern).parameters
        values = read_values(self.context, path, types, given)
        index = support.index_of(values)
        return values if index is None else index
