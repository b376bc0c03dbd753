"""Compute the constant parts of an expression, exactly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from merap.errors import InputError
from merap.program.expressions.operators import DECIDED_BY_LEFT, EXACT, bounded
from merap.program.expressions.tree import (
    IN,
    Constant,
    Constants,
    Expression,
    Lookup,
    Operation,
    Table,
    Variable,
    parts,
    with_parts,
)


def fold(
    expression: Expression,
    constants: Constants,
    operators: Mapping[str, Callable[..., Any]] = EXACT,
) -> Expression:
    """Put constants in and compute every part that has no variable left, exactly.

    `number in name` becomes a lookup in the table that the name stands for.

    A part that may never be needed, as the right side of `x > 0 & 10 / x > 2`, is left as it is where it
    is undefined.

    Raises:
        InputError: division by zero, or a power that is not rational.
    """
    if isinstance(expression, Constant | Variable):
        return _put_in(expression, constants)
    if isinstance(expression, Lookup):
        return _fold_lookup(expression.table, fold(expression.index, constants, operators))
    if expression.operator == IN:
        found = _put_in(expression, constants)
        return found if found == expression else fold(found, constants, operators)
    if expression.operator == "?:":
        return _fold_choice(expression.arguments, constants, operators)
    if expression.operator in DECIDED_BY_LEFT:
        return _fold_logical(expression.operator, expression.arguments, constants, operators)
    arguments = tuple(fold(argument, constants, operators) for argument in expression.arguments)
    return _applied(expression.operator, arguments, operators)


def _applied(
    symbol: str, arguments: tuple[Expression, ...], operators: Mapping[str, Callable[..., Any]]
) -> Expression:
    values = [argument.value for argument in arguments if isinstance(argument, Constant)]
    if len(values) < len(arguments):
        return Operation(symbol, arguments)
    value = operators[symbol](*values)
    return Constant(value if isinstance(value, bool) else bounded(value))


def _fold_lookup(table: Table, index: Expression) -> Expression:
    return Constant(table.at(index.value)) if isinstance(index, Constant) else Lookup(table, index)


def _fold_choice(
    arguments: tuple[Expression, ...],
    constants: Constants,
    operators: Mapping[str, Callable[..., Any]],
) -> Expression:
    """Fold only the side that is taken, once that is known."""
    condition = fold(arguments[0], constants, operators)
    if isinstance(condition, Constant):
        return fold(arguments[1 if condition.value else 2], constants, operators)
    sides = (_fold_if_defined(side, constants, operators) for side in arguments[1:])
    return Operation("?:", (condition, *sides))


def _fold_logical(
    symbol: str,
    arguments: tuple[Expression, ...],
    constants: Constants,
    operators: Mapping[str, Callable[..., Any]],
) -> Expression:
    """Fold the right side only if the left one does not decide."""
    left = fold(arguments[0], constants, operators)
    if not isinstance(left, Constant):
        return Operation(symbol, (left, _fold_if_defined(arguments[1], constants, operators)))
    deciding, result = DECIDED_BY_LEFT[symbol]
    return Constant(result) if left.value is deciding else fold(arguments[1], constants, operators)


def _fold_if_defined(
    expression: Expression,
    constants: Constants,
    operators: Mapping[str, Callable[..., Any]],
) -> Expression:
    try:
        return fold(expression, constants, operators)
    except InputError:
        return _put_in(expression, constants)


def _put_in(expression: Expression, constants: Constants) -> Expression:
    """Put constants in, without computing anything."""
    if isinstance(expression, Variable):
        value = constants.get(expression.name)
        return expression if value is None or isinstance(value, Table) else Constant(value)
    new = tuple(_put_in(part, constants) for part in parts(expression))
    if isinstance(expression, Operation) and expression.operator == IN:
        index, members = new
        table = constants.get(members.name) if isinstance(members, Variable) else None
        return Lookup(table, index) if isinstance(table, Table) else Operation(IN, new)
    return with_parts(expression, new)
