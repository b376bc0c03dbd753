"""The configurations of a concern: listed by name or generated, resolved when asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, Protocol, TypeAlias, TypeVar

import numpy as np

from merap.concerns.combination import Capability, Configuration, DeclaredObjective, Environment, Objective
from merap.concerns.generation import Product
from merap.concerns.parameters import Values, held_locations
from merap.mdp.model import Ints
from merap.mdp.short_repr import ShortRepr

Resolved_co = TypeVar("Resolved_co", covariant=True)
OfEnvironment_co = TypeVar("OfEnvironment_co", bound=Configuration, covariant=True)
OfCapability_co = TypeVar("OfCapability_co", bound=Configuration, covariant=True)
OfObjective_co = TypeVar("OfObjective_co", bound=Objective, covariant=True)


class Configurations(Protocol):
    """Values for the parameters of a concern, by index."""

    @property
    def count(self) -> int:
        """The number of configurations."""

    def values(self, index: int) -> Values:
        """Parameter -> canonical value."""

    def name(self, index: int) -> str:
        """The name of a configuration."""

    def index_of_name(self, name: str) -> int | None:
        """The inverse of `name`; None if there is none."""

    def index_of_values(self, values: Values) -> int | None:
        """The index of the first configuration with these values; None if there is none."""

    def first_with(self, parameter: str, location: int) -> int | None:
        """The index of a configuration whose `parameter` holds `location`; None if none does."""

    def locations(self, parameter: str) -> set[int]:
        """Return every location that `parameter` holds in some configuration."""


@dataclass(frozen=True, repr=False)
class Named(ShortRepr):
    """Configurations listed in the file."""

    names: tuple[str, ...]
    listed: tuple[Values, ...]

    @property
    def count(self) -> int:
        """The number of configurations."""
        return len(self.names)

    def values(self, index: int) -> Values:
        """Parameter -> canonical value."""
        return self.listed[index]

    def name(self, index: int) -> str:
        """The name of a configuration."""
        return self.names[index]

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: index for index, name in enumerate(self.names)}

    def index_of_name(self, name: str) -> int | None:
        """The inverse of `name`; None if there is none."""
        return self._index.get(name)

    def index_of_values(self, values: Values) -> int | None:
        """The index of the first configuration with these values; None if there is none."""
        return self.listed.index(values) if values in self.listed else None

    def first_with(self, parameter: str, location: int) -> int | None:
        """The index of a configuration whose `parameter` holds `location`; None if none does."""
        holding = (i for i, values in enumerate(self.listed) if location in held_locations(values, parameter))
        return next(holding, None)

    def locations(self, parameter: str) -> set[int]:
        """Return every location that `parameter` holds in some configuration."""
        return {location for values in self.listed for location in held_locations(values, parameter)}


@dataclass(frozen=True, eq=False, repr=False)
class Generated(ShortRepr):
    """Configurations of a product, or those of them with the ranks `kept` (int64, rising)."""

    product: Product
    kept: Ints | None = None

    @property
    def count(self) -> int:
        """The number of configurations."""
        return self.product.count if self.kept is None else len(self.kept)

    def values(self, index: int) -> Values:
        """Parameter -> canonical value."""
        return self.product.values(self._rank(index))

    def name(self, index: int) -> str:
        """The name of a configuration."""
        return self.product.name(self._rank(index))

    def _rank(self, index: int) -> int:
        return index if self.kept is None else int(self.kept[index])

    def _index(self, rank: int | None) -> int | None:
        if self.kept is None or rank is None:
            return rank
        index = int(np.searchsorted(self.kept, rank))
        return index if index < len(self.kept) and self.kept[index] == rank else None

    def index_of_name(self, name: str) -> int | None:
        """The inverse of `name`; None if there is none."""
        return self._index(self.product.rank_of_name(name))

    def index_of_values(self, values: Values) -> int | None:
        """The index of the configuration with these values; None if there is none."""
        return self._index(self.product.rank_of_values(values))

    def first_with(self, parameter: str, location: int) -> int | None:
        """The index of a configuration whose `parameter` holds `location`; None if none does."""
        if self.kept is None:
            return self.product.first_with(parameter, location)
        holding = (i for i in range(self.count) if location in held_locations(self.values(i), parameter))
        return next(holding, None)

    def locations(self, parameter: str) -> set[int]:
        """Return every location that `parameter` holds in some configuration."""
        if self.kept is not None:
            return {found for i in range(self.count) for found in held_locations(self.values(i), parameter)}
        return {
            member
            for choice in self.product.choices
            if choice.parameter == parameter
            for member in choice.members
        }


@dataclass(frozen=True, eq=False, repr=False)
class Support(ShortRepr, Generic[Resolved_co]):
    """The finite set of configurations of a concern; each is resolved once, when asked for.

    Attributes:
        configurations: names and parameter values.
        resolve: (name, values) -> the resolved configuration.
        capacity: how many resolved configurations are remembered.
    """

    configurations: Configurations
    resolve: Callable[[str, Values], Resolved_co]
    capacity: int = 100_000
    _resolved: dict[int, Resolved_co] = field(default_factory=dict, repr=False)

    @property
    def count(self) -> int:
        """The number of configurations (`len` where that is a machine integer)."""
        return self.configurations.count

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> Resolved_co:
        if not 0 <= index < self.count:
            raise IndexError(index)
        if index not in self._resolved:
            if len(self._resolved) >= self.capacity:
                self._resolved.pop(next(iter(self._resolved)))
            configurations = self.configurations
            self._resolved[index] = self.resolve(configurations.name(index), configurations.values(index))
        return self._resolved[index]

    def __iter__(self) -> Iterator[Resolved_co]:
        return (self[index] for index in range(self.count))

    def name(self, index: int) -> str:
        """The name of a configuration, without resolving it."""
        return self.configurations.name(index)

    def names(self) -> Iterator[str]:
        """Yield all names in order."""
        return (self.name(index) for index in range(self.count))

    def index(self, name: str) -> int | None:
        """The index of the configuration called `name`; None if there is none."""
        return self.configurations.index_of_name(name)

    def index_of(self, values: Values) -> int | None:
        """The index of the configuration with these canonical values; None if there is none."""
        return self.configurations.index_of_values(values)


@dataclass(frozen=True, eq=False, repr=False)
class Supports(ShortRepr, Generic[OfEnvironment_co, OfCapability_co, OfObjective_co]):
    """The configurations of each concern: N environments, M capabilities, K objectives."""

    environment: Support[OfEnvironment_co]
    capability: Support[OfCapability_co]
    objective: Support[OfObjective_co]


DeclaredSupports: TypeAlias = Supports[Environment, Capability, DeclaredObjective]
