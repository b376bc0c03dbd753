"""Load a case study: a space, the supports of three concerns, and the systems that are met online."""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Generic

import numpy as np
from typing_extensions import TypeVar

from merap.concerns.arguments import as_path, as_text
from merap.concerns.checks import DistributionCheck, check_actions
from merap.concerns.closing import Closing, foreign_names
from merap.concerns.combination import (
    Combination,
    Configuration,
    DeclaredCombination,
    Objective,
)
from merap.concerns.document import Document, KeyPath
from merap.concerns.expression_names import CONCERNS
from merap.concerns.loading import check_at_load, digest, make_resolvers, make_supports, read_case
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolve_space import resolve_space
from merap.concerns.schema import SystemSpec
from merap.concerns.space import Space
from merap.concerns.supports import DeclaredSupports, Supports
from merap.concerns.systems import DeclaredSystemReader, SystemReader
from merap.concerns.vocabulary import action_names, check_vocabulary, declared_variables, mode_names
from merap.concerns.warnings import hidden_words, idle_rules, unused_parameters
from merap.errors import InputError
from merap.mdp.short_repr import ShortRepr
from merap.program.names import suggestion

DEFAULT_LIMIT = 10_000
_NAMES_TO_COMPARE = 2000

Member_co = TypeVar("Member_co", bound=Combination, default=Combination, covariant=True)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CaseStudy(ShortRepr, ABC, Generic[Member_co]):
    """A case file of whatever kind, resolved, with combinations of type `Member_co`.

    Attributes:
        name: of the case.
        source: the case file.
        standalone: its bytes, with the content of other files put in.
        actions: declared names, without `end`.
        discount: of a step, in (0, 1].
        supports: the configurations of each concern.
        systems: name -> a system that is met online.
        digest: hexadecimal SHA-256 of its files.
        warnings: what is allowed but probably not meant, one sentence each.
        read_system: makes systems that are met.
    """

    name: str
    source: Path
    standalone: bytes
    actions: tuple[str, ...]
    discount: float
    supports: Supports[Configuration, Configuration, Objective]
    systems: Mapping[str, Member_co]
    digest: str
    warnings: tuple[str, ...]
    read_system: SystemReader = field(repr=False)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(N, M, K): how many environments, capabilities and objectives there are."""
        supports = self.supports
        return supports.environment.count, supports.capability.count, supports.objective.count

    @property
    def size(self) -> int:
        """N * M * K, the number of combinations."""
        environments, capabilities, objectives = self.shape
        return environments * capabilities * objectives

    def combinations(self, limit: int = DEFAULT_LIMIT) -> Iterator[Member_co]:
        """Return all combinations in order: environment first, objective last and fastest.

        Raises:
            InputError: there are more than `limit`.
        """
        if self.size > limit:
            raise InputError(
                f"{self.name} has {self.size} combinations, "
                f"too many to enumerate (limit {limit}); draw a sample",
                source=str(self.source),
            )
        return (self.combination_at(index) for index in range(self.size))

    def combination_at(self, index: int) -> Member_co:
        """The combination at `index` in the order of `combinations`.

        Raises:
            InputError: there is none at that index, or it can't be resolved.
        """
        if not 0 <= operator.index(index) < self.size:
            raise InputError(
                f"expected an index from 0 to {self.size - 1}, got {index}", source=str(self.source)
            )
        _, capabilities, objectives = self.shape
        rest, objective = divmod(index, objectives)
        environment, capability = divmod(rest, capabilities)
        return self.combine(environment, capability, objective)

    @abstractmethod
    def combine(self, environment: int, capability: int, objective: int) -> Member_co:
        """The combination of three configurations, by their indices.

        Raises:
            InputError: a configuration can't be resolved, or the three do not fit together.
        """

    @property
    def online(self) -> Mapping[str, SystemSpec]:
        """Name -> how the case file describes a system that is met online."""
        return self.read_system.declared

    def met(self, name: str, spec: SystemSpec, document: Document, place: KeyPath) -> Combination:
        """A system that another document describes, as a scenario does.

        Args:
            name: of the system.
            spec: its description.
            document: where it stands.
            place: in the document.

        Raises:
            InputError: a configuration, parameter or location is unknown, or the start is closed.
        """
        return self.read_system.placed(document, place)(name, spec)

    def sample(self, count: int, generator: np.random.Generator | int) -> list[Member_co]:
        """Distinct combinations in random order, each set of `count` equally likely.

        All of them, shuffled, if there are no more than `count`. The generator may be given as its seed.
        """
        generator = np.random.default_rng(generator)
        if self.size <= 2 * count:
            return [self.combination_at(int(index)) for index in generator.permutation(self.size)[:count]]
        drawn: dict[tuple[int, int, int], None] = {}
        while len(drawn) < count:
            columns = [generator.integers(size, size=count).tolist() for size in self.shape]
            drawn.update(dict.fromkeys(zip(*columns, strict=True)))
        return [self.combine(*indices) for indices in list(drawn)[:count]]

    def combination(self, name: str) -> Member_co:
        """The combination called `<environment>.<capability>.<objective>`.

        Raises:
            InputError: there is none; names what is near.
        """
        indices = self._indices(name)
        if indices is None:
            raise InputError(
                f"{self.name} has no combination {name!r}{suggestion(name, self._known_names())}",
                source=str(self.source),
            )
        return self.combine(*indices)

    def _indices(self, name: str) -> tuple[int, int, int] | None:
        parts = as_text(name, "combination").split(".")
        if len(parts) != 3:
            return None
        supports = self.supports
        environment = supports.environment.index(parts[0])
        capability = supports.capability.index(parts[1])
        objective = supports.objective.index(parts[2])
        if environment is None or capability is None or objective is None:
            return None
        return environment, capability, objective

    def _known_names(self) -> list[str]:
        supports = (self.supports.environment, self.supports.capability, self.supports.objective)
        environments, capabilities, objectives = (islice(support.names(), 50) for support in supports)
        listed = [list(capabilities), list(objectives)]
        names = (f"{e}.{c}.{o}" for e in environments for c in listed[0] for o in listed[1])
        return [*self.systems, *islice(names, _NAMES_TO_COMPARE)]

    def system(self, name: str) -> Member_co:
        """The online system called `name`, or the combination.

        Raises:
            InputError: there is neither; names what is near.
        """
        if as_text(name, "system") in self.systems:
            return self.systems[name]
        if self._indices(name) is not None:
            return self.combination(name)
        raise InputError(
            f"{self.name} has no system {name!r}{suggestion(name, self._known_names())}",
            source=str(self.source),
        )

    def covered(self, combination: Combination) -> bool:
        """Return whether `combination` is in the support: its configurations, its start and its horizon."""
        indices = self._indices(
            f"{combination.environment.name}.{combination.capability.name}.{combination.objective.name}"
        )
        if indices is None:
            return False
        return self.supports.objective[indices[2]].same_episodes(combination.objective)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DeclaredCase(CaseStudy[DeclaredCombination]):
    """A case in the case language.

    Attributes:
        space: the locations, attributes at their defaults.
        modes: Q names.
    """

    space: Space
    modes: tuple[str, ...]
    supports: DeclaredSupports
    read_system: DeclaredSystemReader = field(repr=False)

    def combine(self, environment: int, capability: int, objective: int) -> DeclaredCombination:
        """See `CaseStudy`."""
        supports = self.supports
        return self.read_system.combined(
            supports.environment[environment], supports.capability[capability], supports.objective[objective]
        )


def load_declared_case(path: str | PathLike[str]) -> DeclaredCase:
    """Load a case file, or `case.yaml` of a folder.

    Raises:
        InputError: one clear line with file, line and key.
    """
    file, document, spec = read_case(as_path(path, "case"))
    space = resolve_space(document, spec.space)
    check_vocabulary(document, spec, space)
    context = ResolutionContext(
        document,
        space,
        mode_names(spec),
        action_names(spec.capability),
        {concern: getattr(spec, concern).parameters for concern in CONCERNS},
        declared_variables(document, spec, space),
    )
    resolvers = make_resolvers(context, spec)
    supports = make_supports(context, spec, resolvers)
    check_pair = DistributionCheck(context)
    closing = Closing(document, foreign_names(resolvers.names_read()))
    check_at_load(supports, closing, check_pair)
    read_system = DeclaredSystemReader(
        context=context,
        supports=supports,
        declared=spec.online,
        discount=spec.discount,
        digest=digest(document),
        resolvers=resolvers,
        closing=closing,
        check_pair=check_pair,
    )
    systems = {name: read_system(name, system) for name, system in spec.online.items()}
    check_actions(context, spec.capability.actions, supports.capability, systems.values())
    return DeclaredCase(
        name=spec.case,
        source=file,
        standalone=document.standalone,
        space=space,
        modes=context.modes,
        actions=context.actions,
        discount=spec.discount,
        supports=supports,
        systems=systems,
        digest=digest(document),
        warnings=(
            *hidden_words(context),
            *unused_parameters(spec, resolvers),
            *idle_rules(context, supports.capability, resolvers.objective),
        ),
        read_system=read_system,
    )
