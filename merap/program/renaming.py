"""Give variables, actions and processes of a program other names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from merap.program.closing import with_expressions
from merap.program.expressions import Expression, Variable, substitute
from merap.program.form import Process, Program

_NOTHING: Mapping[str, str] = {}


def renamed(
    program: Program,
    variables: Mapping[str, str] = _NOTHING,
    actions: Mapping[str, str] = _NOTHING,
    processes: Mapping[str, str] = _NOTHING,
) -> Program:
    """Return the program with other names, each given as old name -> new name."""
    if not (variables or actions or processes):
        return program
    primes = {f"{name}'": f"{new}'" for name, new in variables.items()}
    read = {name: Variable(new, 0) for name, new in {**variables, **primes}.items()}

    def variable(name: str) -> str:
        return variables.get(name, name)

    def action(name: str | None) -> str | None:
        return None if name is None else actions.get(name, name)

    def assigned(values: Mapping[str, Expression]) -> dict[str, Expression]:
        return {variable(name): value for name, value in values.items()}

    def of_process(process: Process) -> Process:
        return replace(
            process,
            name=processes.get(process.name, process.name),
            variables=tuple(replace(one, name=variable(one.name)) for one in process.variables),
            commands=tuple(
                replace(
                    command,
                    action=action(command.action),
                    draws=tuple(
                        tuple(replace(one, assignments=assigned(one.assignments)) for one in draw)
                        for draw in command.draws
                    ),
                )
                for command in process.commands
            ),
            initial=tuple(replace(one, values=assigned(one.values)) for one in process.initial),
        )

    changed = with_expressions(program, lambda expression: substitute(expression, read))
    rewards = {
        name: replace(
            structure,
            rules=tuple(
                replace(rule, actions=frozenset(map(action, rule.actions))) for rule in structure.rules
            ),
        )
        for name, structure in changed.rewards.items()
    }
    return replace(
        changed,
        processes=tuple(map(of_process, changed.processes)),
        rewards=rewards,
        location=tuple(map(variable, program.location)),
        monitors=frozenset(map(variable, program.monitors)),
        flag=None if program.flag is None else variable(program.flag),
    )
