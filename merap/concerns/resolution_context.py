"""Hold what all configurations of a case share while they are resolved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from merap.concerns.document import Document, KeyPath
from merap.concerns.parameters import (
    EXPRESSION_KINDS,
    ParameterTypes,
    Values,
    find_location,
    find_locations,
    held_locations,
)
from merap.concerns.schema_base import Box, LocationSet
from merap.concerns.space import Space
from merap.errors import InputError
from merap.mdp.model import Bools
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import Constant, Expression, Kind, Value, check, exact, parse, variables
from merap.program.form import ConcernName, StateVariable
from merap.program.names import suggestion


@dataclass(frozen=True, eq=False, repr=False)
class ResolutionContext(ShortRepr):
    """The case's document, space, modes and actions.

    Attributes:
        document: where errors are placed.
        space: the locations.
        modes: Q names.
        actions: names of external, innate and `start_*` actions.
        variables: those of processes by name, with the concern that owns them.
    """

    document: Document
    space: Space
    modes: tuple[str, ...]
    actions: tuple[str, ...]
    variables: Mapping[str, tuple[ConcernName, StateVariable]] = field(default_factory=dict)

    def variable_kinds(
        self, *, primed: tuple[str, ...] = (), reader: ConcernName = "objective"
    ) -> dict[str, Kind]:
        """Return the types of attributes, mode, variables of processes, and names of modes and values.

        Args:
            primed: `attributes`, `mode` and `processes`, if they may be read of the successor too.
            reader: who reads; environment and capability read nothing of the objective.
        """
        kinds: dict[str, Kind] = dict.fromkeys((MODE_VARIABLE, *self.modes, *self.named_values), "number")
        for name, (owner, variable) in self.variables.items():
            if reader == "objective" or owner != "objective":
                kinds[name] = "bool" if variable.kind == "bool" else "number"
                if "processes" in primed:
                    kinds[f"{name}'"] = kinds[name]
        for attribute in self.space.attributes:
            kinds[attribute.name] = "bool" if attribute.kind == "bool" else "number"
            if "attributes" in primed:
                kinds[f"{attribute.name}'"] = kinds[attribute.name]
        if MODE_VARIABLE in primed:
            kinds[f"{MODE_VARIABLE}'"] = "number"
        return kinds

    def compile(
        self, path: KeyPath, given: str | float | bool, kinds: Mapping[str, Kind], expected: Kind
    ) -> Expression:
        """Parse and check an expression of the file; numbers stay exact.

        Raises:
            InputError: with its place.
        """
        with self.document.at(*path):
            if isinstance(given, bool):
                return Constant(given)
            if not isinstance(given, str):
                return Constant(exact(given))
            expression = parse(given)
            check(expression, kinds, expected)
            return expression

    @cached_property
    def named_values(self) -> dict[str, Value]:
        """Name of a variable's value -> its number."""
        return {
            name: exact(variable.low + index)
            for _, variable in self.variables.values()
            for index, name in enumerate(variable.values)
        }

    @cached_property
    def named_constants(self) -> dict[str, Value]:
        """Name of a mode or of a variable's value -> its number."""
        return {name: exact(index) for index, name in enumerate(self.modes)} | self.named_values

    def mode_mask(self, path: KeyPath, names: tuple[str, ...] | None) -> Bools | None:
        """bool [Q], the modes called so; None for None.

        Raises:
            InputError: the case has no such mode.
        """
        if names is None:
            return None
        mask = np.zeros(len(self.modes), dtype=np.bool_)
        for name in names:
            if name not in self.modes:
                raise self.document.error(path, f"unknown mode {name!r}{suggestion(name, self.modes)}")
            mask[self.modes.index(name)] = True
        return frozen(mask)

    def mask(self, indices: tuple[int, ...]) -> Bools:
        """bool [P], true at `indices`."""
        mask = np.zeros(self.space.num_locations, dtype=np.bool_)
        mask[list(indices)] = True
        return frozen(mask)

    def select(self, refs: LocationSet, types: ParameterTypes, values: Values) -> tuple[int, ...]:
        """Return the indices of locations that are named, or held by a parameter that is named.

        Raises:
            InputError: without place: a location is not there.
        """
        if isinstance(refs, Box):
            return find_locations(refs, self.space)
        indices: list[int] = []
        for ref in refs:
            if isinstance(ref, str) and ref in types:
                self.require_location(ref, types)
                indices.extend(held_locations(values, ref))
            else:
                indices.append(find_location(ref, self.space))
        return tuple(indices)

    def require_location(self, parameter: str, types: ParameterTypes) -> None:
        """Refuse a parameter that holds no locations.

        Raises:
            InputError: without place.
        """
        if types[parameter] not in ("location", "locations"):
            raise InputError(
                f"the parameter {parameter!r} is of type {types[parameter]}, it holds no locations"
            )


def frozen(array: Bools) -> Bools:
    """Return the array, read-only."""
    array.flags.writeable = False
    return array


def expression_kinds(types: ParameterTypes) -> dict[str, Kind]:
    """Return the types of the parameters that expressions can read."""
    return {name: EXPRESSION_KINDS[kind] for name, kind in types.items() if kind in EXPRESSION_KINDS}


def names_in(expressions: list[Expression]) -> set[str]:
    """Return the names of the variables in some expressions, without primes."""
    read = (variable for expression in expressions for variable in variables(expression))
    return {variable.name.removesuffix("'") for variable in read}
