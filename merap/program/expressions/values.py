"""Evaluate expressions exactly, for many steps at once.

An expression is computed once for each distinct combination of the values that it reads: first on
arrays of 64-bit integers, then, where these would overflow, on arrays of Python's integers, and one by
one, with `fold`, where the value may be undefined. So no result is rounded before the end, and no
comparison is decided on a rounded number.

Axes: B steps, M distinct combinations of levels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.errors import InputError
from merap.mdp.model import Bools, Ints
from merap.program.expressions.arrays import FUNCTIONS, LARGEST, Numbers, Truths, choose
from merap.program.expressions.columns import Columns, Combinations, Levels, Scope, Value
from merap.program.expressions.folding import fold
from merap.program.expressions.operators import NEAREST
from merap.program.expressions.tree import (
    Constant,
    Expression,
    Lookup,
    Operation,
    Table,
    Variable,
    variables,
)

# Integers up to here are doubles, so that their quotient is the double nearest to the fraction.
EXACT_DOUBLES = 2**53


def evaluate(expression: Expression, scope: Scope) -> npt.NDArray[Any]:
    """Evaluate over columns that broadcast; bool, or the float64 nearest to each number.

    Of a `?:` only the side that is taken has to be defined, of `&`, `|` and `=>` the right side only where
    the left one does not decide.

    Raises:
        InputError: the value is undefined in some step, as after a division by zero.
    """
    table = _Table(expression, scope)
    results = table.rounded()
    for row in table.left_over:
        try:
            value = table.fold(row)
        except InputError as error:
            shown = ", ".join(f"{name} = {_shown(value)}" for name, value in table.constants(row).items())
            message = f"{error.message} for some attribute values ({shown})" if shown else error.message
            raise InputError(message) from error
        results[row] = value if isinstance(value, bool) else float(value)
    return results[table.inverse].reshape(table.shape)


def tabulate(expression: Expression, scope: Scope) -> tuple[list[Value | None], Ints]:
    """Evaluate exactly over columns of one shape.

    Returns:
        The value for each distinct combination of what is read, None where it is undefined, and for
        each step which of them it has: int64 of the columns' shape.
    """
    table = _Table(expression, scope)
    values: list[Value | None] = [*table.exact()]
    for row in table.left_over:
        try:
            values[row] = table.fold(row)
        except InputError:
            values[row] = None
    return values, table.inverse.reshape(table.shape)


def evaluate_where_defined(expression: Expression, scope: Scope) -> tuple[npt.NDArray[Any], Bools]:
    """Evaluate over columns that broadcast.

    Returns:
        The values as `evaluate` gives them, and where they are defined; elsewhere they mean nothing.
    """
    table = _Table(expression, scope)
    results, defined = table.rounded(), np.ones(table.count, dtype=np.bool_)
    for row in table.left_over:
        try:
            value = table.fold(row)
        except InputError:
            defined[row] = False
        else:
            results[row] = value if isinstance(value, bool) else float(value)
    shape, inverse = table.shape, table.inverse
    return results[inverse].reshape(shape), defined[inverse].reshape(shape)


def evaluate_whole(expression: Expression, scope: Scope) -> tuple[Ints, Bools]:
    """Evaluate to whole numbers over columns that broadcast; false counts as 0, true as 1.

    Returns:
        int64 values, and where they are defined, whole and within 64 bits; elsewhere they mean nothing.
    """
    table = _Table(expression, scope)
    results, fits = table.whole()
    for row in table.left_over:
        try:
            value = Fraction(table.fold(row))
        except InputError:
            continue
        fits[row] = value.denominator == 1 and abs(value) < LARGEST
        results[row] = int(value) if fits[row] else 0
    shape, inverse = table.shape, table.inverse
    return results[inverse].reshape(shape), fits[inverse].reshape(shape)


class _Table:
    """The value of an expression for each distinct combination of what it reads.

    Attributes:
        shape: of the columns, broadcast.
        inverse: int64 [B], which combination a step has.
        count: M.
        left_over: indices of combinations for which arrays do not give the value.
    """

    def __init__(self, expression: Expression, scope: Scope) -> None:
        self.expression = expression
        names = tuple(sorted({variable.name for variable in variables(expression)}))
        found = scope.combinations(names) if isinstance(scope, Columns) else Combinations.of(names, scope)
        self.shape, self.inverse, self.count, self._read = found.shape, found.inverse, found.count, found.read
        self._small = _compute(expression, self._read, big=False)
        self._unfit = np.flatnonzero(~np.broadcast_to(self._small.known, self.count))
        self._big, self.left_over = self._small, self._unfit.tolist()
        if len(self._unfit):
            again = {name: (levels, codes[self._unfit]) for name, (levels, codes) in self._read.items()}
            self._big = _compute(expression, again, big=True)
            self.left_over = self._unfit[~np.broadcast_to(self._big.known, len(self._unfit))].tolist()

    def rounded(self) -> npt.NDArray[Any]:
        """[M], bool or the nearest float64; what stands in `left_over` means nothing."""
        results = np.array(np.broadcast_to(_rounded(self._small), self.count))
        if len(self._unfit):
            results[self._unfit] = _rounded(self._big)
        return results

    def whole(self) -> tuple[Ints, Bools]:
        """int64 [M], and bool [M], which are whole and known."""
        results, fits = _whole(self._small, self.count)
        if len(self._unfit):
            results[self._unfit], fits[self._unfit] = _whole(self._big, len(self._unfit))
        return results, fits

    def exact(self) -> list[Value]:
        """The M values; what stands in `left_over` means nothing."""
        values = _exact(self._small, self.count)
        if len(self._unfit):
            for row, value in zip(self._unfit.tolist(), _exact(self._big, len(self._unfit)), strict=True):
                values[row] = value
        return values

    def constants(self, row: int) -> dict[str, Value]:
        """Return what the variables are in a combination."""
        return {name: levels.values[codes[row]] for name, (levels, codes) in self._read.items()}

    def fold(self, row: int) -> Value:
        """Return the value in a combination.

        Raises:
            InputError: it is undefined.
        """
        folded = fold(self.expression, self.constants(row), NEAREST)
        assert isinstance(folded, Constant)
        return folded.value


def _rounded(operand: Numbers | Truths) -> npt.NDArray[Any]:
    """[M], bool or float64: Python's integers are divided exactly, 64-bit ones where doubles hold them."""
    if isinstance(operand, Truths):
        return operand.value
    num, den = operand.num, operand.den
    if num.dtype == np.int64 and np.any((np.abs(num) > EXACT_DOUBLES) | (den > EXACT_DOUBLES)):
        num, den = num.astype(object), den.astype(object)
    return np.asarray(num / den, dtype=np.float64)


def _whole(operand: Numbers | Truths, count: int) -> tuple[Ints, Bools]:
    if isinstance(operand, Truths):
        parts = operand.value.astype(np.int64), operand.known
    else:
        fits = operand.known & (operand.den == 1) & (np.abs(operand.num) < LARGEST)
        parts = np.where(fits, operand.num, 0).astype(np.int64), fits.astype(np.bool_)
    return np.array(np.broadcast_to(parts[0], count)), np.array(np.broadcast_to(parts[1], count))


def _exact(operand: Numbers | Truths, count: int) -> list[Value]:
    if isinstance(operand, Truths):
        return list(np.broadcast_to(operand.value, count).tolist())
    columns = (np.broadcast_to(part, count).tolist() for part in (operand.num, operand.den))
    return [Fraction(num, den) for num, den in zip(*columns, strict=True)]


def _compute(
    expression: Expression, read: Mapping[str, tuple[Levels, Ints]], *, big: bool
) -> Numbers | Truths:
    """Compute on arrays, for M combinations or, where nothing varies, for one."""
    match expression:
        case Constant(value):
            return _constant(value, big)
        case Variable(name):
            levels, codes = read[name]
            return (levels.big if big else levels.small)[codes]
        case Lookup(table, index):
            return _looked_up(table, _compute(index, read, big=big), big=big)
        case Operation("?:", (condition, taken, other)):
            parts = (_compute(part, read, big=big) for part in (condition, taken, other))
            chosen: Numbers | Truths = choose(*parts)
            return chosen
        case Operation(symbol, arguments):
            return FUNCTIONS[symbol](*(_compute(argument, read, big=big) for argument in arguments))


def _looked_up(table: Table, index: Numbers | Truths, *, big: bool) -> Numbers | Truths:
    """Gather values; those at a number that the table does not have are not known."""
    assert isinstance(index, Numbers)
    codes = table.column.codes
    fits = index.known & (index.den == 1) & (index.num >= 0) & (index.num < len(codes))
    levels = table.column.levels
    found = (levels.big if big else levels.small)[codes[np.where(fits, index.num, 0).astype(np.int64)]]
    return replace(found, known=found.known & fits.astype(np.bool_))


@lru_cache(maxsize=4096, typed=True)
def _constant(value: Value, big: bool) -> Numbers | Truths:
    levels = Levels((value,))
    return levels.big if big else levels.small


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(int(value)) if value.denominator == 1 else f"{float(value):.10g}"
