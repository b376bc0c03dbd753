"""The names of a case: legal, disjoint, and numbered once for all configurations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from merap.concerns.document import Document, KeyPath
from merap.concerns.expression_names import CONCERNS
from merap.concerns.parameter_types import SPATIAL, TypeName
from merap.concerns.parameters import ParameterTypes
from merap.concerns.reserved_words import check_action_name, check_readable_name, check_variable_name
from merap.concerns.resolve_processes import process_entries
from merap.concerns.schema import CapabilitySpec, CaseSpec
from merap.concerns.schema_capability import restarts
from merap.concerns.space import Space
from merap.errors import InputError
from merap.mdp.reserved_names import GOAL_LABEL, MODE_VARIABLE
from merap.program.form import ConcernName, StateVariable
from merap.program.names import check_name

READY = "ready"
_MEANINGS: Mapping[str, Mapping[str, tuple[TypeName, ...]]] = {
    "environment": {
        "blocked": ("location", "locations"),
        "blocked_edges": ("edges",),
        "locked": ("doors",),
    },
    "capability": {"no_entry": ("location", "locations")},
    "objective": {GOAL_LABEL: ("location", "locations")},
}


def mode_names(spec: CaseSpec) -> tuple[str, ...]:
    """Return the names of the modes.

    Without innate part there are none; a case of nothing but locations has the one mode `ready`.
    """
    if spec.capability.innate is not None:
        return spec.capability.innate.modes
    is_spatial = spec.space is not None and not any(process_entries(spec, one) for one in CONCERNS)
    return (READY,) if is_spatial else ()


def action_names(spec: CapabilitySpec) -> tuple[str, ...]:
    """External actions, innate actions, `start_<automaton>`; `end` is not declared."""
    names = list(spec.actions)
    if spec.innate is not None:
        names += spec.innate.actions
        if restarts(spec.innate):
            names.append(f"start_{spec.innate.name}")
    return tuple(names)


def check_vocabulary(document: Document, spec: CaseSpec, space: Space) -> None:
    """Refuse illegal names, and names that stand for two things.

    Raises:
        InputError: with the name's place.
    """
    with document.at("case"):
        check_name(spec.case, "a case")
    _check_capability(document, spec.capability)
    _check_attributes(document, spec, space)
    for concern in CONCERNS:
        _check_parameters(document, concern, getattr(spec, concern).parameters, spec, space)
    for name in spec.online:
        with document.at("online", name):
            check_name(name, "an online system")


def declared_variables(
    document: Document, spec: CaseSpec, space: Space
) -> dict[str, tuple[ConcernName, StateVariable]]:
    """Return the variables of all processes by name, with the concern that owns them.

    Raises:
        InputError: a name is illegal or stands for two things, with its place.
    """
    known = dict.fromkeys(mode_names(spec), "a mode")
    known |= {attribute.name: "an attribute" for attribute in space.attributes}
    processes: dict[str, str] = {}
    found: dict[str, tuple[ConcernName, StateVariable]] = {}
    for concern in CONCERNS:
        for entry in process_entries(spec, concern):
            with document.at(*entry.path):
                check_variable_name(entry.name, "a process")
                if entry.name in processes:
                    owner = processes[entry.name]
                    raise InputError(f"duplicate name {entry.name!r}: {owner} has a process of that name")
                processes[entry.name] = f"the {concern}"
                for variable in entry.variables.values():
                    _check_variable(variable, known)
                    found[variable.name] = (concern, variable)
    return found


def _check_variable(variable: StateVariable, known: dict[str, str]) -> None:
    """Refuse a variable whose name or values stand for something else; add them to what is known."""
    check_variable_name(variable.name, "a variable")
    if variable.name in known:
        raise InputError(f"duplicate name {variable.name!r}: it is {known[variable.name]} and a variable")
    known[variable.name] = "a variable"
    for name in variable.values:
        check_name(name, "a value")
    if len(set(variable.values)) < len(variable.values):
        raise InputError(f"a value of {variable.name} stands twice")


def _check_capability(document: Document, spec: CapabilitySpec) -> None:
    if not spec.actions and not (spec.innate and spec.innate.actions):
        raise document.error(("capability", "actions"), "empty concern: the capability has no action")
    seen: dict[str, str] = {}
    for path, name, what in _capability_names(spec):
        with document.at(*path):
            check_action_name(name, what)
            if name in seen:
                raise InputError(f"duplicate name {name!r}: it is {seen[name]} and {what}")
        seen[name] = what
    if spec.innate is not None:
        _check_modes(document, spec.innate.modes)


def _capability_names(spec: CapabilitySpec) -> Iterator[tuple[KeyPath, str, str]]:
    for name in spec.actions:
        yield ("capability", "actions", name), name, "an external action"
    if spec.innate is not None:
        for name in spec.innate.actions:
            yield ("capability", "innate", "actions", name), name, "an innate action"
        path = ("capability", "innate", "name")
        yield path, spec.innate.name, "the automaton"
        yield path, f"start_{spec.innate.name}", "the action that enters the automaton"


def _check_modes(document: Document, modes: tuple[str, ...]) -> None:
    for index, name in enumerate(modes):
        with document.at("capability", "innate", "modes", index):
            check_readable_name(name, "a mode")
            if name in modes[:index]:
                raise InputError(f"duplicate name {name!r}: the mode stands twice")


def _check_parameters(
    document: Document, concern: ConcernName, types: ParameterTypes, spec: CaseSpec, space: Space
) -> None:
    taken = dict.fromkeys(mode_names(spec), "a mode")
    taken |= {attribute.name: "an attribute" for attribute in space.attributes}
    taken |= {MODE_VARIABLE: "the current mode"}
    for entry in process_entries(spec, concern):
        taken |= dict.fromkeys(entry.variables, "a variable")
    for name, of in types.items():
        with document.at(concern, "parameters", name):
            check_name(name, "a parameter")
            if name in taken or name in space.location_index:
                raise InputError(f"duplicate name {name!r}: it is {taken.get(name, 'a location')} already")
            if of.name in SPATIAL and not space.located:
                raise InputError(f"the parameter {name!r} is of type {of}, and the case has no space")
            allowed = _MEANINGS[concern].get(name, (of.name,))
            if of.name not in allowed:
                raise InputError(f"the parameter {name!r} is of type {' or '.join(allowed)}, not {of}")


def _check_attributes(document: Document, spec: CaseSpec, space: Space) -> None:
    names = [attribute.name for attribute in space.attributes]
    for name in names:
        with document.at("space", "attributes", name):
            if name in mode_names(spec):
                raise InputError(f"duplicate name {name!r}: it is a mode already")
