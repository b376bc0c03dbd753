"""Put the draws of commands that are taken together into one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from math import prod

from merap.errors import InputError
from merap.program.expressions import fold, product_of
from merap.program.form import Command, Update
from merap.program.joint_draws import joint_draws

MAX_OUTCOMES = 256


def joint_outcomes(commands: Sequence[Command]) -> Iterator[Update]:
    """Yield every joint outcome of some commands, in terms of the state before the step.

    Raises:
        InputError: there are more than 256.
    """
    count = prod(len(draw) for command in commands for draw in command.draws)
    if count > MAX_OUTCOMES:
        places = ", ".join(command.place for command in commands)
        raise InputError(f"{places}: {count} joint outcomes, at most {MAX_OUTCOMES} are allowed")
    for drawn in product(*(joint_draws(command.draws) for command in commands)):
        probability = product_of(one.probability for one in drawn)
        values = {name: value for one in drawn for name, value in one.assignments.items()}
        yield Update(fold(probability, {}), values)
