"""Put conditions together; a later one need not be defined where an earlier one decides."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from merap.program.expressions import Constant, Expression, Operation
from merap.program.form import TRUE

FALSE = Constant(False)


def all_of(conditions: Sequence[Expression]) -> Expression:
    """Return where all of some conditions hold."""
    return _joined("&", [condition for condition in conditions if condition != TRUE], TRUE)


def none_of(conditions: Sequence[Expression]) -> Expression:
    """Return where none of some conditions holds."""
    return Operation("!", (_joined("|", conditions, FALSE),)) if conditions else TRUE


def _joined(symbol: str, conditions: Sequence[Expression], without: Expression) -> Expression:
    if not conditions:
        return without
    return reduce(lambda left, right: Operation(symbol, (left, right)), conditions)
