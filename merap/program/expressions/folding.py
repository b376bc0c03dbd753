"""Compute the constant parts of an expression, exactly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from merap.program.expressions.operators import EXACT, bounded
from merap.program.expressions.tree import Constant, Expression, Operation, Value, Variable


def fold(
    expression: Expression,
    constants: Mapping[str, Value],
    operators: Mapping[str, Callable[..., Any]] = EXACT,
) -> Expression:
    """Put constants in and compute every part that has no variable left, exactly.

    Raises:
        InputError: division by zero, or a power that is not rational.
    """
    if isinstance(expression, Variable):
        return Constant(constants[expression.name]) if expression.name in constants else expression
    if isinstance(expression, Constant):
        return expression
    if expression.operator == "?:":
        return _fold_choice(expression.arguments, constants, operators)
    arguments = tuple(fold(argument, constants, operators) for argument in expression.arguments)
    values = [argument.value for argument in arguments if isinstance(argument, Constant)]
    if len(values) < len(arguments):
        return Operation(expression.operator, arguments)
    value = operators[expression.operator](*values)
    return Constant(value if isinstance(value, bool) else bounded(value))


def _fold_choice(
    arguments: tuple[Expression, ...],
    constants: Mapping[str, Value],
    operators: Mapping[str, Callable[..., Any]],
) -> Expression:
    """Fold only the side that is taken, once that is known."""
    condition = fold(arguments[0], constants, operators)
    if isinstance(condition, Constant):
        return fold(arguments[1 if condition.value else 2], constants, operators)
    sides = (fold(side, constants, operators) for side in arguments[1:])
    return Operation("?:", (condition, *sides))
