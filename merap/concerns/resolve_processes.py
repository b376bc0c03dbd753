"""Resolve the processes of a concern."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

from merap.concerns.document import KeyPath
from merap.concerns.processes import DeclaredProcess
from merap.concerns.resolution_context import ResolutionContext
from merap.concerns.resolve_changes import ChangeReader
from merap.concerns.schema import CaseSpec
from merap.concerns.schema_processes import ProcessSpec, VariableSpec
from merap.mdp.short_repr import ShortRepr
from merap.program.expressions import (
    ZERO,
    number,
    product_of,
)
from merap.program.form import ConcernName, InitialValues, StateVariable, boolean, integer


@dataclass(frozen=True, eq=False, repr=False)
class ProcessEntry(ShortRepr):
    """A process of the file, or a door, which is one.

    Attributes:
        path: where it stands.
        concern: that owns it.
        name: of the process.
        spec: what the file says.
        initial_key: the key of its initial values.
    """

    path: KeyPath
    concern: ConcernName
    name: str
    spec: ProcessSpec
    initial_key: str = "initial"

    @cached_property
    def variables(self) -> dict[str, StateVariable]:
        """Its variables by name."""
        specs: Mapping[str, VariableSpec] = self.spec.variables or {self.name: self.spec}
        return {own: _variable(own, one) for own, one in specs.items()}


def process_entries(spec: CaseSpec, concern: ConcernName) -> tuple[ProcessEntry, ...]:
    """Return the processes of a concern in order; doors are the first of the environment."""
    doors = spec.space.doors if spec.space is not None and concern == "environment" else {}
    own: Mapping[str, ProcessSpec] = getattr(spec, concern).processes
    return (
        *(
            ProcessEntry(("space", "doors", name), concern, name, door.process, "open")
            for name, door in doors.items()
        ),
        *(ProcessEntry((concern, "processes", name), concern, name, one) for name, one in own.items()),
    )


def _variable(name: str, spec: VariableSpec) -> StateVariable:
    if spec.type is not None:
        return boolean(name)
    if spec.range is not None:
        return integer(name, *spec.range)
    assert spec.values is not None
    return StateVariable(name, ZERO, number(len(spec.values) - 1), "named", spec.values)


def resolve_processes(
    context: ResolutionContext, entries: Sequence[ProcessEntry]
) -> tuple[DeclaredProcess, ...]:
    """Return the processes of a concern, open in the parameters that they read.

    Raises:
        InputError: an expression is wrong, or an action or variable unknown.
    """
    return tuple(_resolved(context, entry) for entry in entries)


def _resolved(context: ResolutionContext, entry: ProcessEntry) -> DeclaredProcess:
    reader, own = ChangeReader(context, entry.concern), entry.variables
    changes = []
    for index, change in enumerate(entry.spec.changes):
        place = (*entry.path, "changes", index)
        actions = reader.actions((*place, "action"), change.action)
        changes.append(reader.change(place, change, own, actions))
        if entry.concern == "objective" and len(changes[-1].outcomes) > 1:
            raise context.document.error(
                (*place, "set"), "a process of the objective watches: it can't draw, give one value"
            )
    return DeclaredProcess(
        entry.name,
        entry.concern,
        tuple(own.values()),
        _initial(reader, entry),
        tuple(changes),
        entry.path,
    )


def _initial(reader: ChangeReader, entry: ProcessEntry) -> tuple[InitialValues, ...]:
    spec, path, own = entry.spec, entry.path, entry.variables
    if spec.initial is not None:
        outcomes = reader.start((*path, entry.initial_key), spec.initial, own)
        return tuple(InitialValues(one.probability, one.assignments) for one in outcomes)
    separate = [
        reader.start((*path, "variables", name, "initial"), one.initial or (), {name: own[name]})
        for name, one in spec.variables.items()
    ]
    return tuple(
        InitialValues(
            product_of(one.probability for one in chosen),
            {name: value for one in chosen for name, value in one.assignments.items()},
        )
        for chosen in product(*separate)
    )
