"""Add slip to a program: with some probability an action does nothing, in any state.

Environment and capability then keep all their values in one joint draw. The step counts, its reward is that
of the step (s, a, s), monitors see that step, and a task that ends after the action (`ends_after`) ends all
the same. `belief.space` holds the same hypothesis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from merap.concerns.combination import Combination
from merap.concerns.processes import together
from merap.errors import InputError
from merap.mdp.model import TabularMDP
from merap.prism.joint_outcomes import joint_outcomes
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.program.expressions import ONE, Constant, Operation, fold
from merap.program.form import Command, Draw, Program, Update

_KEPT: Draw = (Update(ONE),)


def slipping_model(combination: Combination, slip: float) -> TabularMDP:
    """Explore the whole model of a combination that slips.

    Raises:
        InputError: see `slipping`.
        ModelError: a reachable state has no action.
    """
    program = slipping(combination.program, slip)
    return tabular(program, explore(program), reward="objective")


def slipping(program: Program, slip: float) -> Program:
    """Return the program of a system that slips; its processes beside the monitors become one.

    Args:
        program: every command has an action.
        slip: the probability to slip.

    Raises:
        InputError: the probability is not in [0, 1), or a step has more than 256 joint outcomes.
    """
    if not 0 <= slip < 1:
        raise InputError(f"the probability to slip must be in [0, 1), it is {slip}")
    if slip == 0 or not program.moving:
        return program
    one = together(program.moving)
    chance = Fraction(str(slip))
    slipped = replace(
        one, commands=tuple(_slipping(command, chance, program.monitors) for command in one.commands)
    )
    others = [process for process in program.processes if process not in program.moving]
    return replace(program, processes=(slipped, *others))


def _slipping(command: Command, slip: Fraction, monitors: frozenset[str]) -> Command:
    still = replace(
        command, draws=tuple(draw if _watches(draw, monitors) else _KEPT for draw in command.draws)
    )
    return replace(command, draws=((*_weighted(command, 1 - slip), *_weighted(still, slip)),))


def _watches(draw: Draw, monitors: frozenset[str]) -> bool:
    return all(name in monitors for outcome in draw for name in outcome.assignments)


def _weighted(command: Command, weight: Fraction) -> Iterator[Update]:
    for outcome in joint_outcomes([command]):
        chance = Operation("*", (Constant(weight), outcome.probability))
        yield Update(fold(chance, {}), outcome.assignments)
