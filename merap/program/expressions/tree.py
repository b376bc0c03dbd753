"""Define expressions as trees."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, TypeAlias

from merap.mdp.short_repr import ShortRepr

Kind: TypeAlias = Literal["bool", "number"]
Value: TypeAlias = Fraction | bool


@dataclass(frozen=True)
class Constant:
    """A number or a truth value."""

    value: Value


@dataclass(frozen=True)
class Variable:
    """A name, with its prime if it speaks of the successor; `column` counts from 1."""

    name: str
    column: int


@dataclass(frozen=True, repr=False)
class Operation(ShortRepr):
    """An operator or function and its arguments."""

    operator: str
    arguments: tuple[Expression, ...]


Expression: TypeAlias = Constant | Variable | Operation


def variables(expression: Expression) -> Iterator[Variable]:
    """Yield every occurrence of a variable, left to right."""
    if isinstance(expression, Variable):
        yield expression
    elif isinstance(expression, Operation):
        for argument in expression.arguments:
            yield from variables(argument)


def substitute(expression: Expression, values: Mapping[str, Expression]) -> Expression:
    """Return the expression with other expressions in place of some variables."""
    if isinstance(expression, Variable):
        return values.get(expression.name, expression)
    if isinstance(expression, Constant) or not values:
        return expression
    arguments = tuple(substitute(argument, values) for argument in expression.arguments)
    return Operation(expression.operator, arguments)


def exact(number: float) -> Fraction:
    """Return the fraction that a decimal stands for: 0.8 is 4/5, not the nearest double."""
    return Fraction(repr(number)) if isinstance(number, float) else Fraction(number)
