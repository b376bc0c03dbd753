"""End the episodes of a program: in complete states one action is left, which changes nothing."""

from __future__ import annotations

from dataclasses import replace

from merap.mdp.reserved_names import END_ACTION
from merap.program.expressions import ONE, Expression, all_of, any_of, negation
from merap.program.form import Command, InitialValues, Process, Program, Update


def enabled(program: Program) -> Expression:
    """Return where a program has a step."""
    together = [
        all_of(
            [
                any_of([command.guard for command in process.commands if command.action == action])
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
    return any_of([*together, *alone])


def completed(program: Program, complete: Expression, name: str) -> Program:
    """Return the program with the action `end` alone in complete states; it earns no reward there.

    Args:
        program: every command has an action, none is `end`.
        complete: where nothing changes any more, over the state.
        name: of the process that sees to it; no other has it.
    """
    going = negation(complete)
    commands = [_rest(action, going) for action in program.actions]
    last = Process(
        name,
        "objective",
        (),
        (*commands, _rest(END_ACTION, complete)),
        (InitialValues(ONE, {}),),
        "objective: nothing happens any more where the task is complete",
    )
    return replace(program, processes=(*program.processes, last))


def _rest(action: str, guard: Expression) -> Command:
    return Command(action, guard, ((Update(ONE),),), f"[{action}]")
