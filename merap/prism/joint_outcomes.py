"""Put the draws of commands that are taken together into one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import product
from math import prod

from merap.errors import InputError
from merap.program.expressions import Constant, Expression, Operation, Variable, fold, substitute, variables
from merap.program.form import Command, Draw, Update

MAX_OUTCOMES = 256
ONE = Constant(Fraction(1))


def joint_outcomes(commands: Sequence[Command]) -> Iterator[Update]:
    """Yield every joint outcome of some commands, in terms of the state before the step.

    Raises:
        InputError: there are more than 256.
    """
    count = prod(len(draw) for command in commands for draw in command.draws)
    if count > MAX_OUTCOMES:
        places = ", ".join(command.place for command in commands)
        raise InputError(f"{places}: {count} joint outcomes, at most {MAX_OUTCOMES} are allowed")
    for drawn in product(*(product(*command.draws) for command in commands)):
        together: Joint = (ONE, {})
        for outcomes in drawn:
            together = _both(together, _combined(outcomes))
        probability, assignments = together
        yield Update(fold(probability, {}), assignments)


Joint = tuple[Expression, dict[str, Expression]]


def _both(left: Joint, right: Joint) -> Joint:
    return _times(left[0], right[0]), left[1] | right[1]


def _combined(outcomes: Draw) -> Joint:
    """Put later draws, which may read what earlier ones gave, in terms of the state before the step."""
    probability: Expression = ONE
    known: dict[str, Expression] = {}
    for outcome in outcomes:
        probability = _times(probability, _before(outcome.probability, known))
        known |= {name: _before(value, known) for name, value in outcome.assignments.items()}
    return probability, known


def _before(expression: Expression, known: dict[str, Expression]) -> Expression:
    """Put in what earlier outcomes have given; what none of them has assigned keeps its value."""
    names = {one.name.removesuffix("'") for one in variables(expression) if one.name.endswith("'")}
    return substitute(expression, {f"{name}'": known.get(name, Variable(name, 0)) for name in names})


def _times(left: Expression, right: Expression) -> Expression:
    if left == ONE:
        return right
    return left if right == ONE else Operation("*", (left, right))
