"""Tell labels that may hold from those that are plainly false."""

from __future__ import annotations

from merap.program.expressions import Constant, Expression, Lookup, Value, fold, parts, with_parts
from merap.program.form import Program


def may_hold(program: Program, label: str) -> bool:
    """Return whether a label exists and is not false by its definition.

    Variables that no command assigns keep their initial value. States are not looked at: a label may hold
    though no state that can be reached has it.
    """
    if label not in program.labels:
        return False
    return fold(_plain(program.labels[label]), _fixed(program)) != Constant(False)


def _plain(expression: Expression) -> Expression:
    """Return an expression with constants in place of tables that have one value everywhere."""
    if isinstance(expression, Lookup) and expression.table.lone is not None:
        return expression.table.lone
    return with_parts(expression, tuple(map(_plain, parts(expression))))


def _fixed(program: Program) -> dict[str, Value]:
    """Return the variables that never change, with their value."""
    if program.initial_predicate is not None:
        return {}
    fixed: dict[str, Value] = {}
    for process in program.processes:
        assigned = {
            name
            for command in process.commands
            for draw in command.draws
            for update in draw
            for name in update.assignments
        }
        for name in {one.name for one in process.variables} - assigned:
            starts = {start.values.get(name) for start in process.initial}
            (value, *others) = starts
            if not others and isinstance(value, Constant):
                fixed[name] = value.value
    return fixed
