"""Put draws that are made one after the other into one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

from merap.program.expressions import (
    ONE,
    Expression,
    Variable,
    product_of,
    substitute,
    variables,
)
from merap.program.form import Draw, Update


def joint_draws(draws: Sequence[Draw]) -> Iterator[Update]:
    """Yield every joint outcome of the draws of a command, in terms of the state before the step."""
    for outcomes in product(*draws):
        probability: Expression = ONE
        known: dict[str, Expression] = {}
        for outcome in outcomes:
            probability = product_of([probability, _before(outcome.probability, known)])
            known |= {name: _before(value, known) for name, value in outcome.assignments.items()}
        yield Update(probability, known)


def _before(expression: Expression, known: dict[str, Expression]) -> Expression:
    """Put in what earlier outcomes have given; what none of them has assigned keeps its value."""
    names = {one.name.removesuffix("'") for one in variables(expression) if one.name.endswith("'")}
    return substitute(expression, {f"{name}'": known.get(name, Variable(name, 0)) for name in names})
