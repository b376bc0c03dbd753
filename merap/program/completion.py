"""End the episodes of a program: in complete states one action is left, which changes nothing."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from fractions import Fraction
from functools import reduce

from merap.mdp.reserved_names import END_ACTION
from merap.program.expressions import Constant, Expression, Operation
from merap.program.form import Command, InitialValues, Process, Program, Update

_ONE, _YES, _NO = Constant(Fraction(1)), Constant(True), Constant(False)


def negated(condition: Expression) -> Expression:
    """Return where a condition does not hold."""
    return Operation("!", (condition,))


def either(conditions: Collection[Expression]) -> Expression:
    """Return where one of some conditions holds."""
    return _joined("|", conditions) if conditions else _NO


def both(conditions: Collection[Expression]) -> Expression:
    """Return where all of some conditions hold."""
    return _joined("&", conditions) if conditions else _YES


def _joined(operator: str, conditions: Collection[Expression]) -> Expression:
    return reduce(lambda one, other: Operation(operator, (one, other)), dict.fromkeys(conditions))


def enabled(program: Program) -> Expression:
    """Return where a program has a step."""
    together = [
        both(
            [
                either([command.guard for command in process.commands if command.action == action])
                for process in program.processes
                if action in process.actions
            ]
        )
        for action in program.actions
    ]
    alone = [
        command.guard
        for process in program.processes
        for command in process.commands
        if command.action is None
    ]
    return either([*together, *alone])


def completed(program: Program, complete: Expression, name: str) -> Program:
    """Return the program with the action `end` alone in complete states; it earns no reward there.

    Args:
        program: every command has an action, none is `end`.
        complete: where nothing changes any more, over the state.
        name: of the process that sees to it; no other has it.
    """
    going = negated(complete)
    commands = [_rest(action, going) for action in program.actions]
    last = Process(
        name,
        "objective",
        (),
        (*commands, _rest(END_ACTION, complete)),
        (InitialValues(_ONE, {}),),
        "objective: nothing happens any more where the task is complete",
    )
    return replace(program, processes=(*program.processes, last))


def _rest(action: str, guard: Expression) -> Command:
    return Command(action, guard, ((Update(_ONE),),), f"[{action}]")
