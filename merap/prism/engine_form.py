"""Expressions in a form that both engines compute alike, and as exactly as can be."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from merap.program.expressions import Constant, Expression, Lookup, Operation, Variable, fold

_DISTRIBUTED = frozenset({"+", "-", "*", "neg", "min", "max"})
_OF_EQUALS = {"=": True, "<=": True, ">=": True, "!=": False, "<": False, ">": False}


def engine_form(expression: Expression) -> Expression:
    """The same value for the engines to compute.

    `1 - (c ? 4/5 : 1)` becomes `c ? 1/5 : 0`: an exact fraction, and nothing at all where a
    complement is impossible. `mod(a, b)` becomes `a - b * floor(a / b)`, since Storm's own `mod`
    is wrong where an argument is below 0. Truth values that are known are left out.
    """
    if isinstance(expression, Variable):
        return Variable(expression.name, 0)  # so that it equals the same name elsewhere
    if isinstance(expression, Constant):
        return expression
    if isinstance(expression, Lookup):
        lone = expression.table.lone
        return fold(Lookup(expression.table, engine_form(expression.index)), {}) if lone is None else lone
    return simplified(
        Operation(expression.operator, tuple(engine_form(argument) for argument in expression.arguments))
    )


def simplified(form: Operation) -> Expression:
    """Return the same operation of parts that are in engine form."""
    symbol, arguments = form.operator, form.arguments
    if symbol == "mod":
        quotient = Operation("floor", (Operation("/", arguments),))
        return engine_form(Operation("-", (arguments[0], Operation("*", (arguments[1], quotient)))))
    if symbol in _DISTRIBUTED or (symbol == "/" and _is_not_zero(arguments[1])):
        return _distributed(form)
    if symbol in ("&", "|"):
        return _logical(form)
    if symbol in _OF_EQUALS and arguments[0] == arguments[1]:
        return Constant(_OF_EQUALS[symbol])
    return fold(form, {})


def joined(symbol: str, terms: Sequence[Expression]) -> Expression:
    """Return the conjunction or disjunction of some conditions, at least one."""
    return reduce(lambda left, right: simplified(Operation(symbol, (left, right))), terms)


def _is_not_zero(expression: Expression) -> bool:
    return isinstance(expression, Constant) and expression.value != 0


def is_table(expression: Expression) -> bool:
    """Return whether it is a constant in every case, so that no engine has to compute it."""
    if isinstance(expression, Operation) and expression.operator == "?:":
        return all(is_table(side) for side in expression.arguments[1:])
    return isinstance(expression, Constant)


def _logical(expression: Operation) -> Expression:
    """`true & x` is `x`, `false & x` is `false`; the other way round with `|`."""
    neutral, deciding = Constant(expression.operator == "&"), Constant(expression.operator == "|")
    if deciding in expression.arguments:
        return deciding
    rest = tuple(argument for argument in expression.arguments if argument != neutral)
    if len(rest) == len(expression.arguments):
        return expression
    return rest[0] if rest else neutral


def _distributed(expression: Operation) -> Expression:
    """Arithmetic of one `?:` and constants, done on both sides of the `?:`."""
    places = [place for place, part in enumerate(expression.arguments) if not isinstance(part, Constant)]
    if not places:
        return fold(expression, {})
    inner = expression.arguments[places[0]]
    if len(places) > 1 or not isinstance(inner, Operation) or inner.operator != "?:":
        return expression
    before, after = expression.arguments[: places[0]], expression.arguments[places[0] + 1 :]
    sides = (
        _distributed(Operation(expression.operator, (*before, side, *after))) for side in inner.arguments[1:]
    )
    return Operation("?:", (inner.arguments[0], *sides))
