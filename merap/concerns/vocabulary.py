"""The names of a case: legal, disjoint, and numbered once for all configurations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from merap.concerns.document import Document, KeyPath
from merap.concerns.parameters import ParameterTypes
from merap.concerns.schema import CapabilitySpec, CaseSpec, ParameterType
from merap.concerns.schema_capability import restarts
from merap.concerns.space import Space
from merap.errors import InputError
from merap.mdp.reserved_names import GOAL_LABEL, MODE_VARIABLE
from merap.program.names import check_emitted_name, check_name

READY = "ready"
_MEANINGS: Mapping[str, Mapping[str, tuple[ParameterType, ...]]] = {
    "environment": {"blocked": ("location", "locations"), "blocked_edges": ("edges",)},
    "capability": {"no_entry": ("location", "locations")},
    "objective": {GOAL_LABEL: ("location", "locations")},
}


def mode_names(spec: CapabilitySpec) -> tuple[str, ...]:
    """Q names; a case without innate part has the one mode `ready`."""
    return spec.innate.modes if spec.innate is not None else (READY,)


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
    for concern in ("environment", "capability", "objective"):
        _check_parameters(document, concern, getattr(spec, concern).parameters, spec, space)
    for name in spec.online:
        with document.at("online", name):
            check_name(name, "an online system")


def _check_capability(document: Document, spec: CapabilitySpec) -> None:
    if not spec.actions and not (spec.innate and spec.innate.actions):
        raise document.error(("capability", "actions"), "empty concern: the capability has no action")
    seen: dict[str, str] = {}
    for path, name, what in _capability_names(spec):
        with document.at(*path):
            check_emitted_name(name, what)
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
        yield ("capability", "innate", "name"), spec.innate.name, "the automaton"


def _check_modes(document: Document, modes: tuple[str, ...]) -> None:
    for index, name in enumerate(modes):
        with document.at("capability", "innate", "modes", index):
            check_emitted_name(name, "a mode")
            if name in modes[:index]:
                raise InputError(f"duplicate name {name!r}: the mode stands twice")


def _check_parameters(
    document: Document, concern: str, types: ParameterTypes, spec: CaseSpec, space: Space
) -> None:
    taken = dict.fromkeys(mode_names(spec.capability), "a mode")
    taken |= {attribute.name: "an attribute" for attribute in space.attributes}
    taken |= {MODE_VARIABLE: "the current mode"}
    for name, kind in types.items():
        with document.at(concern, "parameters", name):
            check_name(name, "a parameter")
            if name in taken or name in space.location_index:
                raise InputError(f"duplicate name {name!r}: it is {taken.get(name, 'a location')} already")
            allowed = _MEANINGS[concern].get(name, (kind,))
            if kind not in allowed:
                raise InputError(f"the parameter {name!r} is of type {' or '.join(allowed)}, not {kind}")


def _check_attributes(document: Document, spec: CaseSpec, space: Space) -> None:
    names = [attribute.name for attribute in space.attributes]
    # Text of a combination calls attribute x of the cell that label l leads to attribute_x_l.
    derived = {f"{name}_{label}": name for name in names for label in space.moves}
    for name in names:
        with document.at("space", "attributes", name):
            if name in mode_names(spec.capability):
                raise InputError(f"duplicate name {name!r}: it is a mode already")
            if name in derived:
                raise InputError(
                    f"duplicate name {name!r}: attribute {derived[name]!r} and an edge label make it too"
                )
