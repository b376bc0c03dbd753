"""Write an expression so that engines, which compute in doubles, decide it as fractions would.

Storm and PRISM-games decide comparisons on rounded numbers. Here both sides of a comparison are brought
onto one denominator, which is left out, so that whole numbers are compared, and doubles hold these exactly.
Where this is not possible, as for a quotient of variables, a table over the values that are read is written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import lcm, prod
from typing import TypeAlias

from merap.errors import InputError
from merap.program.expressions import Constant, Expression, Operation, Value, Variable, fold, variables

COMPARISONS = frozenset({"=", "!=", "<", "<=", ">", ">="})
LOGICAL = frozenset({"=>", "<=>", "|", "&", "!"})
MAX_TABLE = 4096
# Whole numbers up to here are exact in doubles; integers of PRISM-games end before.
MAX_EXACT = 2**53
MAX_INTEGER = 2**31 - 1

# The least and the greatest value of a variable; of a truth value None.
Domains: TypeAlias = Mapping[str, tuple[int, int] | None]


class _NotWhole(Exception):  # noqa: N818
    """An expression that can't be written as a whole number over a constant denominator."""


@dataclass(frozen=True)
class _Scaled:
    """A number: an expression over whole numbers, divided by a constant; bounds are those before."""

    over: Expression
    by: int
    low: int
    high: int


def exact_truth(expression: Expression, domains: Domains) -> Expression:
    """Return a condition that engines decide exactly.

    Raises:
        InputError: it compares what can't be computed exactly, and reads too many values for a table.
    """
    match expression:
        case Operation(symbol, arguments) if symbol in LOGICAL:
            return Operation(symbol, tuple(exact_truth(argument, domains) for argument in arguments))
        case Operation("?:", arguments):
            return Operation("?:", tuple(exact_truth(argument, domains) for argument in arguments))
        case Operation(symbol, (left, right)) if symbol in COMPARISONS:
            if is_truth(left, domains):
                return Operation(symbol, (exact_truth(left, domains), exact_truth(right, domains)))
            try:
                one, other, _ = _on_one_denominator(_scaled(left, domains), _scaled(right, domains))
            except _NotWhole:
                return table(expression, domains)
            return Operation(symbol, (one.over, other.over))
        case _:
            return expression


def exact_whole(expression: Expression, domains: Domains) -> Expression:
    """Return a whole number that engines compute exactly.

    Raises:
        InputError: it can't be computed exactly, and reads too many values for a table.
    """
    try:
        scaled = _scaled(expression, domains)
    except _NotWhole:
        return table(expression, domains)
    if scaled.by == 1:
        return scaled.over
    return Operation("floor", (Operation("/", (scaled.over, _number(scaled.by))),))


def rounded_number(expression: Expression, domains: Domains) -> Expression:
    """Return a number that engines compute up to rounding, by decisions that are exact."""
    match expression:
        case Operation("?:", (condition, taken, other)):
            sides = (rounded_number(taken, domains), rounded_number(other, domains))
            return Operation("?:", (exact_truth(condition, domains), *sides))
        case Operation(("floor" | "ceil" | "mod"), _):
            return exact_whole(expression, domains)
        case Operation(symbol, arguments):
            return Operation(symbol, tuple(rounded_number(argument, domains) for argument in arguments))
        case _:
            return expression


def table(expression: Expression, domains: Domains) -> Expression:
    """Return the same as a tree of `?:` over the values of the variables it reads, with constants as leaves.

    Raises:
        InputError: they have too many joint values.
    """
    names = sorted({variable.name for variable in variables(expression)})
    ranges = [_values(domains[name]) for name in names]
    count = prod(len(values) for values in ranges)
    if count > MAX_TABLE:
        raise InputError(
            f"an expression over {', '.join(names)} has {count} cases, at most {MAX_TABLE} can be listed; "
            "let it read fewer values, or compare whole numbers"
        )
    leaves: list[Value | None] = []
    for values in product(*ranges):
        try:
            folded = fold(expression, dict(zip(names, values, strict=True)))
        except InputError:
            leaves.append(None)  # undefined there: no reachable state may have these values
            continue
        assert isinstance(folded, Constant)
        leaves.append(folded.value)
    nothing: Value = False if is_truth(expression, domains) else Fraction(0)
    return _tree(names, ranges, _filled(leaves, nothing))


def is_truth(expression: Expression, domains: Domains) -> bool:
    """Tell whether the value is true or false, not a number."""
    match expression:
        case Constant(value):
            return isinstance(value, bool)
        case Variable(name):
            return domains[name] is None
        case Operation("?:", arguments):
            return is_truth(arguments[1], domains)
        case Operation(symbol, _):
            return symbol in COMPARISONS | LOGICAL


def _values(domain: tuple[int, int] | None) -> list[Value]:
    if domain is None:
        return [False, True]
    return [Fraction(value) for value in range(domain[0], domain[1] + 1)]


def _filled(leaves: list[Value | None], nothing: Value) -> list[Value]:
    """Where the value is undefined any will do: take the one before, so that runs get long."""
    known = [leaf for leaf in leaves if leaf is not None]
    last = known[0] if known else nothing
    filled = []
    for leaf in leaves:
        last = last if leaf is None else leaf
        filled.append(last)
    return filled


def _tree(names: list[str], ranges: list[list[Value]], leaves: list[Value]) -> Expression:
    if leaves == leaves[:1] * len(leaves):
        return Constant(leaves[0])
    size = len(leaves) // len(ranges[0])
    parts = [leaves[start : start + size] for start in range(0, len(leaves), size)]
    runs = [0, *(place for place in range(1, len(parts)) if parts[place] != parts[place - 1])]
    trees = [_tree(names[1:], ranges[1:], parts[place]) for place in runs]
    return _split(Variable(names[0], 0), [ranges[0][place] for place in runs], trees)


def _split(variable: Variable, starts: list[Value], trees: list[Expression]) -> Expression:
    """Balanced: the tree of the run in which a variable's value lies."""
    if len(trees) == 1 or all(tree == trees[0] for tree in trees):
        return trees[0]
    if isinstance(starts[0], bool):
        return Operation("?:", (variable, trees[1], trees[0]))
    middle = len(trees) // 2
    before = _split(variable, starts[:middle], trees[:middle])
    after = _split(variable, starts[middle:], trees[middle:])
    return Operation("?:", (Operation("<", (variable, Constant(starts[middle]))), before, after))


def _number(value: int) -> Constant:
    return Constant(Fraction(value))


def _checked(over: Expression, by: int, low: int, high: int) -> _Scaled:
    if max(abs(low), abs(high), by) > MAX_INTEGER:
        raise _NotWhole
    return _Scaled(over, by, low, high)


def _scaled(expression: Expression, domains: Domains) -> _Scaled:
    match expression:
        case Constant(value):
            exact = Fraction(value)
            return _checked(_number(exact.numerator), exact.denominator, exact.numerator, exact.numerator)
        case Variable(name):
            domain = domains[name]
            assert domain is not None, name
            return _checked(expression, 1, *domain)
        case Operation("?:", (condition, taken, other)):
            one, two, by = _on_one_denominator(_scaled(taken, domains), _scaled(other, domains))
            over = Operation("?:", (exact_truth(condition, domains), one.over, two.over))
            return _checked(over, by, min(one.low, two.low), max(one.high, two.high))
        case Operation(symbol, arguments):
            scale: Callable[..., _Scaled] = _SCALED[symbol]
            return scale(*(_scaled(argument, domains) for argument in arguments))


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
    factors = [one for one in (left.over, right.over) if one != _number(1)]
    over = Operation("*", (left.over, right.over)) if len(factors) == 2 else (*factors, _number(1))[0]
    return _checked(over, left.by * right.by, min(corners), max(corners))


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
