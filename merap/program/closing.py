"""Change every expression of a program; put the values of its parameters in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from merap.program.expressions import Expression, Value, fold
from merap.program.form import Command, InitialValues, Process, Program, RewardStructure, Update


def closed(program: Program, values: Mapping[str, Value]) -> Program:
    """Put the values of parameters into a program.

    Raises:
        InputError: an expression can't be computed with them.
    """
    return with_expressions(program, lambda expression: fold(expression, values))


def with_expressions(program: Program, change: Callable[[Expression], Expression]) -> Program:
    """Return the program with every expression changed."""

    def changed(given: Mapping[str, Expression]) -> dict[str, Expression]:
        return {name: change(expression) for name, expression in given.items()}

    def of_command(command: Command) -> Command:
        draws = tuple(
            tuple(Update(change(one.probability), changed(one.assignments)) for one in draw)
            for draw in command.draws
        )
        return replace(command, guard=change(command.guard), draws=draws)

    def of_process(process: Process) -> Process:
        return replace(
            process,
            variables=tuple(
                replace(one, least=change(one.least), greatest=change(one.greatest))
                for one in process.variables
            ),
            commands=tuple(of_command(command) for command in process.commands),
            initial=tuple(
                InitialValues(change(one.probability), changed(one.values)) for one in process.initial
            ),
        )

    def of_rewards(structure: RewardStructure) -> RewardStructure:
        rules = (replace(one, value=change(one.value), guard=change(one.guard)) for one in structure.rules)
        return replace(structure, rules=tuple(rules))

    predicate = program.initial_predicate
    return replace(
        program,
        processes=tuple(of_process(process) for process in program.processes),
        labels=changed(program.labels),
        rewards={name: of_rewards(structure) for name, structure in program.rewards.items()},
        initial_predicate=None if predicate is None else change(predicate),
        definitions=changed(program.definitions),
    )
