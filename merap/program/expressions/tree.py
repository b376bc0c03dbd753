"""Define expressions as trees."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from merap.errors import InputError
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions.columns import Column, Value

# Only `in` reads a set of locations, which a parameter holds.
Kind: TypeAlias = Literal["bool", "number", "locations"]
IN = "in"


@dataclass(frozen=True)
class Constant:
    """A number or a truth value; 1 is not `true`, as it is in Python."""

    value: Value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Constant) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[bool, Value]:
        return isinstance(self.value, bool), self.value


@dataclass(frozen=True)
class Variable:
    """A name, with its prime if it speaks of the successor, or a label in quotes; `column` counts from 1."""

    name: str
    column: int


@dataclass(frozen=True, repr=False)
class Operation(ShortRepr):
    """An operator or function and its arguments."""

    operator: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Table(ShortRepr):
    """Values by number, as those of an attribute at every location. A table equals itself alone.

    Attributes:
        name: what text calls the value.
        column: M values; entry m is that of number m.
        step: what text adds to the name of a table that is read at this one's value.
        meaning: a comment for text, and what messages call the value; empty: none.
    """

    name: str
    column: Column
    step: str = ""
    meaning: str = ""

    @property
    def kind(self) -> Kind:
        """The type of the values."""
        return "bool" if isinstance(self.column.levels.values[0], bool) else "number"

    @cached_property
    def lone(self) -> Constant | None:
        """The value, if it is the same everywhere."""
        first = self.column.codes[0]
        return Constant(self.column.levels.values[first]) if np.all(self.column.codes == first) else None

    def at(self, number: Value) -> Value:
        """Return one value.

        Raises:
            InputError: there is no such number.
        """
        count = len(self.column.codes)
        if number.denominator != 1 or not 0 <= number < count:
            raise InputError(f"{self.name} has no value at {number}, it has {count}, from 0 on")
        code: int = self.column.codes[int(number)]
        return self.column.levels.values[code]


@dataclass(frozen=True, repr=False)
class Lookup(ShortRepr):
    """The value in a table at a number; undefined where the table has no such number."""

    table: Table
    index: Expression


Expression: TypeAlias = Constant | Variable | Operation | Lookup
# What parameters stand for; a set of numbers is the table of its members.
Constants: TypeAlias = Mapping[str, Value | Table]


def parts(expression: Expression) -> tuple[Expression, ...]:
    """Return the expressions that one is made of."""
    if isinstance(expression, Operation):
        return expression.arguments
    return (expression.index,) if isinstance(expression, Lookup) else ()


def with_parts(expression: Expression, new: tuple[Expression, ...]) -> Expression:
    """Return the expression made of other parts."""
    if isinstance(expression, Operation):
        return Operation(expression.operator, new)
    return Lookup(expression.table, new[0]) if isinstance(expression, Lookup) else expression


def variables(expression: Expression) -> Iterator[Variable]:
    """Yield every occurrence of a variable, left to right."""
    if isinstance(expression, Variable):
        yield expression
    for part in parts(expression):
        yield from variables(part)


def substitute(expression: Expression, values: Mapping[str, Expression]) -> Expression:
    """Return the expression with other expressions in place of some variables."""
    if isinstance(expression, Variable):
        return values.get(expression.name, expression)
    if not values:
        return expression
    return with_parts(expression, tuple(substitute(part, values) for part in parts(expression)))
