"""Find the parameters of a program: the names that no process owns."""

from __future__ import annotations

from collections.abc import Iterator

from merap.program.expressions import Expression, variables
from merap.program.form import Program


def parameters(program: Program) -> frozenset[str]:
    """Return the names that expressions of a program read and no process owns."""
    read = {
        one.name.removesuffix("'") for expression in _expressions(program) for one in variables(expression)
    }
    return frozenset(read - {one.name for one in program.variables})


def _expressions(program: Program) -> Iterator[Expression]:
    for process in program.processes:
        for variable in process.variables:
            yield from (variable.least, variable.greatest)
        for start in process.initial:
            yield from (start.probability, *start.values.values())
        for command in process.commands:
            yield command.guard
            for outcome in (one for draw in command.draws for one in draw):
                yield from (outcome.probability, *outcome.assignments.values())
    for structure in program.rewards.values():
        for rule in structure.rules:
            yield from (rule.guard, rule.value)
    yield from program.labels.values()
    if program.initial_predicate is not None:
        yield program.initial_predicate
