"""Resolve the names in expressions: whose parameter, variable, attribute or mode each of them is.

A name is looked for in the concern that reads it, then in the space, then in the other concerns; two of
these that share a name are told apart as `environment.up`. In a resolved expression a parameter is called
`<concern>.<name>`, whoever reads it; variables and attributes keep their names, and the names of values and
modes have become numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from merap.concerns.location_tables import HERE
from merap.concerns.location_words import AT, LocationWords, cell
from merap.concerns.parameter_types import ParameterType
from merap.concerns.parameters import ParameterTypes, find_locations, parameter_name
from merap.concerns.schema_base import Box, LocationSet
from merap.concerns.space import Space
from merap.errors import InputError
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import (
    Column,
    Constant,
    Expression,
    Kind,
    Lookup,
    Operation,
    Table,
    Value,
    Variable,
    exact,
    parts,
    with_parts,
)
from merap.program.form import ConcernName, StateVariable
from merap.program.names import suggestion

CONCERNS: tuple[ConcernName, ...] = ("environment", "capability", "objective")
# What may be read of the successor where the whole step is known.
STEP = frozenset({"location", "attributes", MODE_VARIABLE, "processes"})
_COMPARISONS = frozenset({"=", "!=", "<", "<=", ">", ">="})
NO_VALUES: Mapping[str, Value] = {}


def numbered(names: tuple[str, ...], low: int = 0) -> dict[str, Value]:
    """Return name -> number, counted from `low`."""
    return {name: exact(low + index) for index, name in enumerate(names)}


@dataclass(frozen=True, eq=False, repr=False)
class ExpressionNames(ShortRepr):
    """The names that expressions of one concern may use.

    Attributes:
        reader: the concern.
        parameters: of each concern.
        variables: those of processes by name, with the concern that owns them; environment and capability
            read nothing of the objective.
        space: the locations and their attributes.
        modes: names of the modes.
        primed: `location`, `attributes`, `mode` and `processes`, if they may be read of the successor too.
        of_state: whether there is a state to read; else parameters alone.
        foreign: whether parameters of other concerns may be read.
        labels: in double quotes -> the resolved condition.
    """

    reader: ConcernName
    parameters: Mapping[ConcernName, ParameterTypes]
    variables: Mapping[str, tuple[ConcernName, StateVariable]]
    space: Space
    modes: tuple[str, ...]
    primed: frozenset[str] = frozenset()
    of_state: bool = True
    foreign: bool = True
    labels: Mapping[str, Expression] = field(default_factory=dict)

    @cached_property
    def kinds(self) -> Mapping[str, Kind]:
        """The types of all names that may occur in a resolved expression."""
        found: dict[str, Kind] = {
            name: of.kind
            for name, of in self._types.items()
            if of.kind is not None and name.partition(".")[0] in self._readable
        }
        if not self.of_state:
            return found
        found |= self._words.kinds
        state: dict[str, tuple[str, Kind]] = {MODE_VARIABLE: (MODE_VARIABLE, "number")} if self.modes else {}
        for one in self.space.attributes:
            state[one.name] = "attributes", "bool" if one.kind == "bool" else "number"
        for name, (owner, variable) in self.variables.items():
            if owner in self._readable:
                state[name] = "processes", "bool" if variable.kind == "bool" else "number"
        for name, (group, of_type) in state.items():
            found[name] = of_type
            if group in self.primed:
                found[f"{name}'"] = of_type
        return found

    @cached_property
    def _types(self) -> dict[str, ParameterType]:
        """The types of all parameters by resolved name, those of the reader first."""
        ordered = sorted(self.parameters, key=lambda concern: concern != self.reader)
        return {
            parameter_name(concern, name): of
            for concern in ordered
            for name, of in self.parameters[concern].items()
        }

    @cached_property
    def _words(self) -> LocationWords:
        held = (name.partition(".")[2] for name, of in self._types.items() if of.holds_locations)
        return LocationWords(self.space, self.of_state, "location" in self.primed, tuple(held))

    @cached_property
    def _readable(self) -> tuple[ConcernName, ...]:
        """The concerns of which something may be read, the own one first."""
        if not self.foreign:
            return (self.reader,)
        others = (one for one in CONCERNS if one != self.reader)
        return (self.reader, *(one for one in others if self.reader == "objective" or one != "objective"))

    def resolve(self, expression: Expression, values: Mapping[str, Value] = NO_VALUES) -> Expression:
        """Return an expression with every name resolved.

        Args:
            expression: as parsed.
            values: names of values that may stand for the whole: those of the variable that it is for.

        Raises:
            InputError: a name is unknown, ambiguous, or can't be read here.
        """
        match expression:
            case Operation(symbol, _) if symbol.startswith(AT):
                return self._words.membership(expression, self._held)
            case Variable(name):
                return Constant(values[name]) if name in values else self._resolved(expression, values)
            case Operation("?:", (condition, taken, other)):
                chosen = (self.resolve(side, values) for side in (taken, other))
                return Operation("?:", (self.resolve(condition), *chosen))
            case Operation(symbol, (left, right)) if symbol in _COMPARISONS:
                sides = self.resolve(left, self._values(right)), self.resolve(right, self._values(left))
                return Operation(symbol, sides)
        return with_parts(expression, tuple(self.resolve(part) for part in parts(expression)))

    def located(self, refs: LocationSet, prime: str = "") -> Expression:
        """Return whether the location, or with a prime that of the successor, is among some locations.

        Raises:
            InputError: a location is unknown.
        """
        if isinstance(refs, Box):
            mask = np.zeros(self.space.num_locations, dtype=np.bool_)
            mask[list(find_locations(refs, self.space))] = True
            return Lookup(Table("", Column.of(mask)), Variable(HERE + prime, 0))
        places = tuple(Variable(ref, 0) if isinstance(ref, str) else cell(*ref) for ref in refs)
        return self._words.membership(Operation(AT + prime, places), self._held)

    def _held(self, place: Variable) -> Variable | None:
        """Return the parameter of locations that has a name."""
        found = self._find(place)
        of = None if found is None else self._types.get(found)
        if found is None or of is None:
            return None
        if not of.holds_locations:
            raise InputError(f"the parameter {place.name!r} is of type {of}, it holds no locations")
        if found not in self.kinds:
            raise InputError(f"{place.name!r} can't be read here: {self._hidden(found)}")
        return Variable(found, place.column)

    def _values(self, compared: Expression) -> Mapping[str, Value]:
        """Return the names of the values of what is compared."""
        if not isinstance(compared, Variable):
            return NO_VALUES
        name = compared.name.removesuffix("'")
        if name == MODE_VARIABLE:
            return numbered(self.modes)
        found = self._find(Variable(name, compared.column))
        if found is None:
            return NO_VALUES
        if found in self.variables:
            _, variable = self.variables[found]
            return numbered(variable.values, variable.low)
        return numbered(self._types[found].value_names) if found in self._types else NO_VALUES

    def _resolved(self, variable: Variable, values: Mapping[str, Value]) -> Expression:
        if variable.name in self.labels:
            return self.labels[variable.name]
        if variable.name.startswith('"'):
            near = suggestion(variable.name, self.labels)
            raise InputError(f"unknown label {variable.name} at column {variable.column}{near}")
        name = variable.name.removesuffix("'")
        found = self._find(Variable(name, variable.column))
        if found is None and name == variable.name and self.of_state and name in self.modes:
            return Constant(exact(self.modes.index(name)))
        place = f"at column {variable.column}"
        word = self._words.meaning(variable) if found is None else None
        if word is not None:
            return word
        if found is None:
            names = [one.rpartition(".")[2] for one in self.kinds if HERE not in one]
            known = dict.fromkeys([*values, *names])
            raise InputError(f"unknown variable {variable.name!r} {place}{suggestion(variable.name, known)}")
        resolved = found + variable.name[len(name) :]
        if self.kinds.get(resolved, "locations") == "locations":
            raise InputError(f"{variable.name!r} {place} can't be read here: {self._reason(found)}")
        return Variable(resolved, variable.column)

    def _reason(self, found: str) -> str:
        """Return why a name that means something can't be read."""
        of = self._types.get(found)
        if of is not None and of.kind in (None, "locations"):
            return f"it is of type {of}" + ("; it can stand in at(..)" if of.holds_locations else "")
        return self._hidden(found)

    def _hidden(self, found: str) -> str:
        owner = found.partition(".")[0] if "." in found else self.variables.get(found, (self.reader,))[0]
        if owner == "objective" != self.reader:
            return "environment and capability read nothing of the objective"
        if not self.foreign and owner != self.reader:
            return f"it belongs to the {owner}"
        return f"what {found} becomes is not known" if self.of_state else "parameters alone can be"

    def _find(self, variable: Variable) -> str | None:
        """Return the name that a name without prime is resolved to; None: it means nothing."""
        concern, dot, own = variable.name.partition(".")
        if dot:
            return {str(one): found for one, found in self._owned(own).items()}.get(concern)
        owners = self._owned(variable.name)
        if self.reader in owners:
            return owners[self.reader]
        attributes = {one.name for one in self.space.attributes}
        if variable.name in attributes or (variable.name == MODE_VARIABLE and self.modes):
            return variable.name
        visible = [one for one in owners if one in self._readable] or list(owners)
        if len(visible) > 1:
            both = " or ".join(f"{one}.{variable.name}" for one in visible)
            raise InputError(f"{variable.name!r} at column {variable.column} is ambiguous: write {both}")
        return owners[visible[0]] if visible else None

    def _owned(self, name: str) -> dict[ConcernName, str]:
        """Return which concerns have a parameter or variable called so, and its resolved name."""
        found: dict[ConcernName, str] = {
            one: parameter_name(one, name) for one in CONCERNS if name in self.parameters.get(one, {})
        }
        if name in self.variables:
            found[self.variables[name][0]] = name
        return found
