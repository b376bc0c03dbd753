"""Hold what all configurations of a case share while they are resolved."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from merap.concerns.document import Document, KeyPath
from merap.concerns.expression_names import NO_VALUES, ExpressionNames
from merap.concerns.parameters import (
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
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import (
    Constant,
    Expression,
    Kind,
    Lookup,
    Operation,
    Value,
    Variable,
    check,
    exact,
    parse,
    variables,
)
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
        parameters: of each concern.
        variables: those of processes by name, with the concern that owns them.
        labels: of the objective, in double quotes -> the resolved condition.
    """

    document: Document
    space: Space
    modes: tuple[str, ...]
    actions: tuple[str, ...]
    parameters: Mapping[ConcernName, ParameterTypes] = field(default_factory=dict)
    variables: Mapping[str, tuple[ConcernName, StateVariable]] = field(default_factory=dict)
    labels: Mapping[str, Expression] = field(default_factory=dict)

    def names(
        self,
        reader: ConcernName,
        *,
        primed: Collection[str] = (),
        of_state: bool = True,
        foreign: bool = True,
    ) -> ExpressionNames:
        """Return the names that expressions of a concern may use; see there for the arguments."""
        return ExpressionNames(
            reader,
            self.parameters,
            self.variables,
            self.space,
            self.modes,
            frozenset(primed),
            of_state,
            foreign,
            self.labels if reader == "objective" and of_state else {},
        )

    def compile(
        self,
        path: KeyPath,
        given: str | float | bool | Expression,
        names: ExpressionNames,
        expected: Kind,
        values: Mapping[str, Value] = NO_VALUES,
    ) -> Expression:
        """Parse, resolve and check an expression of the file; numbers stay exact.

        Args:
            path: its place.
            given: the expression, as text or parsed.
            names: that it may use.
            expected: its type.
            values: names of values that may stand for the whole.

        Raises:
            InputError: with its place.
        """
        with self.document.at(*path):
            expression = names.resolve(as_expression(given), values)
            check(expression, names.kinds, expected)
            return expression

    def mode(self, path: KeyPath, name: str) -> int:
        """Return the number of a mode.

        Raises:
            InputError: the case has no such mode.
        """
        if name not in self.modes:
            raise self.document.error(path, f"unknown mode {name!r}{suggestion(name, self.modes)}")
        return self.modes.index(name)

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
        if not types[parameter].holds_locations:
            raise InputError(
                f"the parameter {parameter!r} is of type {types[parameter]}, it holds no locations"
            )


def frozen(array: Bools) -> Bools:
    """Return the array, read-only."""
    array.flags.writeable = False
    return array


def as_expression(given: str | float | bool | Expression) -> Expression:
    """Return what a value of the file says as an expression; numbers stay exact.

    Raises:
        InputError: a syntax error.
    """
    if isinstance(given, str):
        return parse(given)
    if isinstance(given, Constant | Variable | Operation | Lookup):
        return given
    return Constant(given if isinstance(given, bool) else exact(given))


def names_in(expressions: list[Expression]) -> set[str]:
    """Return the names of the variables in some expressions, without primes."""
    read = (variable for expression in expressions for variable in variables(expression))
    return {variable.name.removesuffix("'") for variable in read}
