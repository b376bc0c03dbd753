"""Expressions in a form that both engines compute alike, and as exactly as can be."""

from __future__ import annotations

from merap.concerns.expressions import Constant, Expression, Operation, fold

_DISTRIBUTED = frozenset({"+", "-", "*", "neg", "min", "max"})


def engine_form(expression: Expression) -> Expression:
    """The same value for the engines to compute.

    `1 - (c ? 4/5 : 1)` becomes `c ? 1/5 : 0`: an exact fraction, and nothing at all where a
    complement is impossible. `mod(a, b)` becomes `a - b * floor(a / b)`, since Storm's own `mod`
    is wrong where an argument is below 0.
    """
    if not isinstance(expression, Operation):
        return expression
    arguments = tuple(engine_form(argument) for argument in expression.arguments)
    if expression.operator == "mod":
        left, right = arguments
        quotient = Operation("floor", (Operation("/", (left, right)),))
        return engine_form(Operation("-", (left, Operation("*", (right, quotient)))))
    if expression.operator in _DISTRIBUTED:
        return _distributed(Operation(expression.operator, arguments))
    return Operation(expression.operator, arguments)


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
