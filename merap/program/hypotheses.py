"""Give parameters values under many hypotheses, and evaluate expressions at a state for all of them.

Each concern has an axis of hypotheses of its own, and an expression has only the axes of the parameters
that it reads: with 100 environments, 10 capabilities and 10 objectives, what reads parameters of the
environment is computed 100 times, not 10,000 times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from merap.errors import InputError
from merap.mdp.model import Bools, Ints
from merap.program.expressions import (
    Column,
    Columns,
    Expression,
    Levels,
    Scope,
    Value,
    evaluate_where_defined,
    evaluate_whole,
    fold,
    variables,
)
from merap.program.expressions.operators import NEAREST

# Bytes of results that are kept for states that are met again, and what each takes besides its arrays.
MAX_KEPT, OVERHEAD = 1 << 26, 500
# Values [..] that broadcast to the hypotheses, and where they are defined.
Evaluated: TypeAlias = tuple[npt.NDArray[Any], Bools]
NOTHING_VARIES: Mapping[str, Column] = {}


class Hypotheses(Columns):
    """The values of parameters under every hypothesis.

    Args:
        concerns: for each axis: parameter -> its value under each hypothesis of the axis, one length for
            all of them. A mapping without parameters is an axis of length 1.

    Attributes:
        shape: the length of each axis.

    Raises:
        InputError: lengths differ, an axis is empty, a parameter stands in two axes, or it is a truth
            value under some hypotheses and a number under others.
    """

    def __init__(self, concerns: Sequence[Mapping[str, Sequence[Value] | npt.NDArray[Any]]]) -> None:
        self._columns: dict[str, Column] = {}
        lengths = []
        for axis, parameters in enumerate(concerns):
            length = len(next(iter(parameters.values()), [None]))
            if length == 0:
                raise InputError(f"there is no hypothesis about {', '.join(parameters)}")
            for name, values in parameters.items():
                if name in self._columns:
                    raise InputError(f"the parameter {name} stands in two axes of hypotheses")
                if len(values) != length:
                    raise InputError(f"the parameter {name} has {len(values)} values, expected {length}")
                column = _column(name, values)
                along = tuple(length if place == axis else 1 for place in range(len(concerns)))
                self._columns[name] = Column(column.levels, column.codes.reshape(along))
            lengths.append(length)
        self.shape = tuple(lengths)

    def __getitem__(self, name: str) -> Column:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


def _column(name: str, values: Sequence[Value] | npt.NDArray[Any]) -> Column:
    if isinstance(values, np.ndarray):
        return Column.of(values)
    if len({isinstance(value, bool) for value in values}) > 1:
        raise InputError(f"the parameter {name} is a truth value here, a number there")
    place = {value: number for number, value in enumerate(dict.fromkeys(values))}
    levels = Levels(tuple(value if isinstance(value, bool) else Fraction(value) for value in place))
    return Column(levels, np.array([place[value] for value in values], dtype=np.int64))


class PointEvaluator:
    """Evaluates expressions where variables have known values, for all hypotheses at once.

    Variables are given as integers, false and true as 0 and 1. What was computed for the same values
    before is not computed anew.

    Args:
        hypotheses: about the parameters.
        truths: the variables that are true or false.
    """

    def __init__(self, hypotheses: Hypotheses, truths: frozenset[str]) -> None:
        self.hypotheses = hypotheses
        self.truths = truths
        self._read: dict[int, tuple[Expression, tuple[str, ...]]] = {}
        self._kept: dict[tuple[object, ...], Evaluated] = {}
        self._bytes = 0

    def truth(
        self, expression: Expression, known: Mapping[str, int], varying: Mapping[str, Column] = NOTHING_VARIES
    ) -> Bools:
        """Return where a condition is defined and holds: bool, broadcasting to the hypotheses.

        Args:
            expression: over parameters, `known` and `varying`.
            known: variable -> its value.
            varying: variable -> its value under each hypothesis.
        """
        holds, defined = self.value(expression, known, varying)
        both: Bools = holds & defined
        return both

    def value(
        self, expression: Expression, known: Mapping[str, int], varying: Mapping[str, Column] = NOTHING_VARIES
    ) -> Evaluated:
        """Return bool or the nearest float64, and where it is defined; arguments as of `truth`."""
        return self._evaluated(evaluate_where_defined, expression, known, varying)

    def whole(
        self, expression: Expression, known: Mapping[str, int], varying: Mapping[str, Column] = NOTHING_VARIES
    ) -> tuple[Ints, Bools]:
        """Return int64, and where the value is defined and whole; arguments as of `truth`."""
        return self._evaluated(evaluate_whole, expression, known, varying)

    def _evaluated(
        self,
        evaluate: Callable[[Expression, Scope], Evaluated],
        expression: Expression,
        known: Mapping[str, int],
        varying: Mapping[str, Column],
    ) -> Evaluated:
        names = self._names(expression)
        if varying and not varying.keys().isdisjoint(names):
            settled = {name: value for name, value in known.items() if name not in varying}
            return self._computed(evaluate, expression, settled, {**self.hypotheses, **varying})
        key = (evaluate, id(expression), *(known.get(name) for name in names))
        if key not in self._kept:
            found = self._computed(evaluate, expression, known, self.hypotheses)
            self._bytes += OVERHEAD + sum(part.nbytes for part in found)
            if self._bytes > MAX_KEPT:
                self._kept.clear()
                self._bytes = 0
            self._kept[key] = found
        return self._kept[key]

    def _names(self, expression: Expression) -> tuple[str, ...]:
        """Return the names that an expression reads; it is kept, so that its identity stays its own."""
        if id(expression) not in self._read:
            names = tuple(sorted({one.name for one in variables(expression)}))
            self._read[id(expression)] = (expression, names)
        return self._read[id(expression)][1]

    def _computed(
        self,
        evaluate: Callable[[Expression, Scope], Evaluated],
        expression: Expression,
        known: Mapping[str, int],
        scope: Scope,
    ) -> Evaluated:
        """Put in what is known first: often little is left that depends on the hypothesis."""
        constants = {
            name: bool(known[name]) if name.removesuffix("'") in self.truths else Fraction(known[name])
            for name in self._names(expression)
            if name in known
        }
        try:
            left = fold(expression, constants, NEAREST)
        except InputError:  # undefined, whatever the parameters are
            return np.array(False), np.array(False)
        return evaluate(left, scope)
