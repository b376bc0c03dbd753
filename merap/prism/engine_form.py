"""Expressions in a form that both engines compute alike, and as exactly as can be."""

from __future__ import annotations

from merap.concerns.expressions import Constant, Expression, Operation, fold

_DISTRIBUTED = frozenset({"+", "-", "*", "neg", "min", "max"})
_OF_EQUALS = {"=": True, "<=": True, ">=": True, "!=": False, "<": False, ">": False}


def engine_form(expression: Expression) -> Expression:
    """The same value for the engines to compute.

    `1 - (c ? 4/5 : 1)` becomes `c ? 1/5 : 0`: an exact fraction, and nothing at all where a
    complement is impossible. `mod(a, b)` becomes `a - b * floor(a / b)`, since Storm's own `mod`
    is wrong where an argument is below 0. Truth values that are known are left out.
    """
    if not isinstance(expression, Operation):
        return expression
    form = Operation(expression.operator, tuple(engine_form(argument) for argument in expression.arguments))
    if form.operator == "mod":
        left, right = form.arguments
        quotient = Operation("floor", (Operation("/", (left, right)),))
        return engine_form(Operation("-", (left, Operation("*", (right, quotient)))))
    if form.operator in _DISTRIBUTED or (form.operator == "/" and _is_not_zero(form.arguments[1])):
        return _distributed(form)
    if form.operator in ("&", "|"):
        return _logical(form)
    if form.operator in _OF_EQUALS and form.arguments[0] == form.arguments[1]:
        return Constant(_OF_EQUALS[form.operator])
    return fold(form, {})


def _is_not_zero(expression: Expression) -> bool:
    return isinstance(expression, Constant) and expression.value != 0


def is_table(expression: Expression) -> bool:
    """Whether it is a constant in every case, so that no engine has to compute it."""
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
