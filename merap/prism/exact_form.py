"""Write an expression so that engines, which compute in doubles, decide it as fractions would.

Storm and PRISM-games decide comparisons on rounded numbers. Here both sides of a comparison are brought
onto one denominator, which is left out, so that whole numbers are compared, and doubles hold these exactly.
Where this is not possible, as for a quotient of variables, a table over the values that are read is written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import lcm
from typing import Protocol

from merap.errors import InputError
from merap.prism.engine_form import simplified
from merap.prism.value_tables import COMPARISONS, Domains, least_of
from merap.program.expressions import Constant, Expression, Lookup, Operation, Variable, fold, product_of

# Whole numbers up to here are exact in doubles; integers of PRISM-games end before.
MAX_EXACT = 2**53
MAX_INTEGER = 2**31 - 1


class Known(Protocol):
    """What is known of the names that an expression reads."""

    @property
    def domains(self) -> Domains:
        """The variables."""

    def named(self, expression: Expression) -> Expression | None:
        """Return the name of an expression that has one, as every lookup has."""

    def table(self, expression: Expression) -> Expression:
        """Return the same as something that engines read without computing.

        Raises:
            InputError: the expression reads too many values.
        """


class _NotWhole(Exception):  # noqa: N818
    """An expression that can't be written as a whole number over a constant denominator."""


@dataclass(frozen=True)
class _Scaled:
    """A number: an expression over whole numbers, divided by a constant; bounds are those before."""

    over: Expression
    by: int
    low: int
    high: int


def exact_truth(expression: Expression, known: Known) -> Expression:
    """Return a condition that engines decide exactly.

    Raises:
        InputError: it compares what can't be computed exactly, and reads too many values for a table.
    """
    named = known.named(expression)
    if named is not None:
        return named
    if not isinstance(expression, Operation):
        return expression
    symbol, arguments = expression.operator, expression.arguments
    if symbol not in COMPARISONS or known.domains.is_truth(arguments[0]):
        return simplified(Operation(symbol, tuple(exact_truth(argument, known) for argument in arguments)))
    try:
        one, other, _ = _on_one_denominator(*(_scaled(side, known) for side in arguments))
    except _NotWhole:
        return known.table(expression)
    return Operation(symbol, (one.over, other.over))


def exact_whole(expression: Expression, known: Known) -> Expression:
    """Return a whole number that engines compute exactly.

    Raises:
        InputError: it can't be computed exactly, and reads too many values for a table.
    """
    try:
        scaled = _scaled(expression, known)
    except _NotWhole:
        return known.table(expression)
    if scaled.by == 1:
        return scaled.over
    return Operation("floor", (Operation("/", (scaled.over, _number(scaled.by))),))


def rounded_number(expression: Expression, known: Known) -> Expression:
    """Return a number that engines compute up to one rounding, by decisions that are exact.

    Where that is not possible, and a table would be too large, the number is computed as it stands.
    """
    named = known.named(expression)
    if named is not None:
        return named
    match expression:
        case Operation("?:", (condition, taken, other)):
            sides = (rounded_number(taken, known), rounded_number(other, known))
            return Operation("?:", (exact_truth(condition, known), *sides))
        case Operation():
            try:
                return _rounded_once(expression, known)
            except InputError:
                return expression
        case _:
            return expression


def _rounded_once(expression: Expression, known: Known) -> Expression:
    try:
        scaled = _scaled(expression, known)
    except _NotWhole:
        return known.table(expression)
    return scaled.over if scaled.by == 1 else Operation("/", (scaled.over, _number(scaled.by)))


def least(expression: Expression, known: Known) -> Fraction:
    """Return a number that no value of an expression is below: by interval arithmetic, or else by its table.

    Raises:
        InputError: it has no such bound, and reads too many values for a table.
    """
    try:
        scaled = _scaled(expression, known)
    except _NotWhole:
        return least_of(expression, known.domains)
    return Fraction(scaled.low, scaled.by)


def _number(value: int) -> Constant:
    return Constant(Fraction(value))


def _checked(over: Expression, by: int, low: int, high: int) -> _Scaled:
    if max(abs(low), abs(high), by) > MAX_INTEGER:
        raise _NotWhole
    return _Scaled(over, by, low, high)


def _scaled(expression: Expression, known: Known) -> _Scaled:
    found = _computed(expression, known)
    named = known.named(expression) if found.by == 1 else None
    return found if named is None else replace(found, over=named)


def _computed(expression: Expression, known: Known) -> _Scaled:
    match expression:
        case Constant(value):
            exact = Fraction(value)
            return _checked(_number(exact.numerator), exact.denominator, exact.numerator, exact.numerator)
        case Variable(name):
            variable = known.domains[name]
            return _checked(expression, 1, variable.low, variable.high)
        case Lookup(table, _):
            levels = table.column.levels
            if not levels.are_whole:
                raise _NotWhole
            return _checked(expression, 1, int(min(levels.values)), int(max(levels.values)))
        case Operation("?:", (condition, taken, other)):
            one, two, by = _on_one_denominator(_scaled(taken, known), _scaled(other, known))
            over = Operation("?:", (exact_truth(condition, known), one.over, two.over))
            return _checked(over, by, min(one.low, two.low), max(one.high, two.high))
        case Operation(symbol, arguments):
            scale: Callable[..., _Scaled] = _SCALED[symbol]
            return scale(*(_scaled(argument, known) for argument in arguments))


def _on_one_denominator(left: _Scaled, right: _Scaled) -> tuple[_Scaled, _Scaled, int]:
    by = lcm(left.by, right.by)
    return _times(left, by // left.by), _times(right, by // right.by), by


def _times(number: _Scaled, factor: int) -> _Scaled:
    """The number over a denominator that is so many times as large."""
    if factor == 1:
        return number
    over = fold(Operation("*", (_number(factor), number.over)), {})
    return _checked(over, number.by * factor, number.low * factor, number.high * factor)


def _sum(left: _Scaled, right: _Scaled) -> _Scaled:
    one, two, by = _on_one_denominator(left, right)
    return _checked(Operation("+", (one.over, two.over)), by, one.low + two.low, one.high + two.high)


def _difference(left: _Scaled, right: _Scaled) -> _Scaled:
    one, two, by = _on_one_denominator(left, right)
    return _checked(Operation("-", (one.over, two.over)), by, one.low - two.high, one.high - two.low)


def _negative(number: _Scaled) -> _Scaled:
    return _checked(Operation("neg", (number.over,)), number.by, -number.high, -number.low)


def _product(left: _Scaled, right: _Scaled) -> _Scaled:
    corners = [one * two for one in (left.low, left.high) for two in (right.low, right.high)]
    return _checked(product_of([left.over, right.over]), left.by * right.by, min(corners), max(corners))


def _quotient(left: _Scaled, right: _Scaled) -> _Scaled:
    if right.low != right.high or right.low == 0:
        raise _NotWhole
    inverse = Fraction(right.by, right.low)
    number = _number(inverse.numerator)
    return _product(left, _checked(number, inverse.denominator, inverse.numerator, inverse.numerator))


def _extreme(symbol: str, *numbers: _Scaled) -> _Scaled:
    by = lcm(*(number.by for number in numbers))
    same = [_times(number, by // number.by) for number in numbers]
    choose = min if symbol == "min" else max
    over = Operation(symbol, tuple(number.over for number in same))
    return _checked(over, by, choose(one.low for one in same), choose(one.high for one in same))


def _floor(number: _Scaled) -> _Scaled:
    if number.by == 1:
        return number
    over = Operation("floor", (Operation("/", (number.over, _number(number.by))),))
    return _checked(over, 1, number.low // number.by, number.high // number.by)


def _ceil(number: _Scaled) -> _Scaled:
    return _negative(_floor(_negative(number)))


def _modulo(left: _Scaled, right: _Scaled) -> _Scaled:
    return _difference(left, _product(right, _floor(_quotient(left, right))))


def _power(base: _Scaled, exponent: _Scaled) -> _Scaled:
    if exponent.low != exponent.high or exponent.by != 1 or not 0 <= exponent.low <= 16:
        raise _NotWhole
    result = _checked(_number(1), 1, 1, 1)
    for _ in range(exponent.low):
        result = _product(result, base)
    return result


_SCALED: Mapping[str, Callable[..., _Scaled]] = {
    "+": _sum,
    "-": _difference,
    "neg": _negative,
    "*": _product,
    "/": _quotient,
    "min": lambda *numbers: _extreme("min", *numbers),
    "max": lambda *numbers: _extreme("max", *numbers),
    "floor": _floor,
    "ceil": _ceil,
    "mod": _modulo,
    "pow": _power,
}
