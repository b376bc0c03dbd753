"""Bring values of parameters from the file's form to one canonical form and back.

Canonical forms, by type: `location` an index; `locations` a tuple of rising indices; `edges`
a tuple of rising (location, label) indices; `probability`, `int`, `real` a `Fraction`; of `values` a number
itself, of names the position; `bool` a `bool`. Equal values have equal canonical forms.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
from pydantic_core import PydanticCustomError

from merap.concerns.parameter_types import ParameterType
from merap.concerns.schema_base import Box, LocationRef, LocationSet, location_set, shown
from merap.concerns.space import Space
from merap.errors import InputError
from merap.program.expressions import Column, Table, Value
from merap.program.form import ConcernName
from merap.program.names import suggestion

Edge: TypeAlias = tuple[int, int]
ParameterValue: TypeAlias = bool | Fraction | int | tuple[int, ...] | tuple[Edge, ...]
ParameterTypes: TypeAlias = Mapping[str, ParameterType]
Values: TypeAlias = Mapping[str, ParameterValue]


def parse_value(of: ParameterType, raw: Any, space: Space) -> ParameterValue:
    """Return the canonical form of a value of a parameter, from a file or as `present` has it.

    Raises:
        InputError: it is not in the domain, or names a location or edge that is not there.
    """
    raw = _with_tuples(raw)
    if of.holds_locations:
        indices = find_locations(parse_location_set(raw), space)
        if of.is_set:
            return tuple(sorted(set(indices)))
        if len(indices) != 1:
            raise InputError(f"expected one location, got {shown(raw)}")
        return indices[0]
    if of.name == "doors":
        return tuple(sorted(set(find_doors(raw, space))))
    return _parse_edges(raw, space) if of.is_set else of.parse(raw)


def _with_tuples(raw: Any) -> Any:
    """Return `raw` with its lists as tuples, as sequences of a file arrive."""
    return tuple(map(_with_tuples, raw)) if isinstance(raw, list | tuple) else raw


def parse_location_set(raw: Any) -> LocationSet:
    """Parse locations as the schema does; its message becomes an `InputError`."""
    try:
        return location_set(raw)
    except PydanticCustomError as error:
        raise InputError(error.message()) from error


def find_locations(refs: LocationSet, space: Space) -> tuple[int, ...]:
    """Return the indices of the locations, in the order given.

    Raises:
        InputError: a location is not there.
    """
    _require_space(space)
    if isinstance(refs, Box):
        return _cells(refs, space)
    return tuple(find_location(ref, space) for ref in refs)


def find_location(ref: LocationRef, space: Space) -> int:
    """Return the index of a location.

    Raises:
        InputError: it is not there.
    """
    _require_space(space)
    if isinstance(ref, str):
        if ref not in space.location_index:
            raise InputError(f"unknown location {ref!r}{suggestion(ref, space.locations)}")
        return space.location_index[ref]
    if space.shape is None:
        raise InputError(f"unknown location {list(ref)}: [row, col] belongs to a grid, give a name")
    rows, cols = space.shape
    if not (0 <= ref[0] < rows and 0 <= ref[1] < cols):
        raise InputError(f"unknown location {list(ref)}: rows are 0 to {rows - 1}, columns 0 to {cols - 1}")
    return ref[0] * cols + ref[1]


def _require_space(space: Space) -> None:
    if not space.located:
        raise InputError("this speaks of locations, and the case has no space")


def _cells(box: Box, space: Space) -> tuple[int, ...]:
    if space.shape is None:
        raise InputError("a box of rows and cols belongs to a grid; list the names of the locations")
    for corner in ((box.rows[0], box.cols[0]), (box.rows[1], box.cols[1])):
        find_location(corner, space)
    cols = space.shape[1]
    return tuple(
        row * cols + col
        for row in range(box.rows[0], box.rows[1] + 1)
        for col in range(box.cols[0], box.cols[1] + 1)
    )


def _parse_edges(raw: Any, space: Space) -> tuple[Edge, ...]:
    if not isinstance(raw, tuple):
        raise InputError(f"expected a list of edges [from, to] or [from, to, label], got {shown(raw)}")
    return tuple(sorted({edge for entry in raw for edge in find_edges(entry, space)}))


def find_edges(entry: Any, space: Space) -> tuple[Edge, ...]:
    """Return the (location, label) indices of `[from, to]` (all labels) or `[from, to, label]`.

    Raises:
        InputError: it has another form, or there is no such edge.
    """
    if not isinstance(entry, tuple) or len(entry) not in (2, 3):
        raise InputError(f"expected an edge [from, to] or [from, to, label], got {shown(entry)}")
    source, target = (_edge_end(end, space) for end in entry[:2])
    labels = [index for index in range(len(space.moves)) if space.target[source, index] == target]
    if len(entry) == 3:
        labels = [index for index in labels if space.moves[index] == entry[2]]
    if not labels:
        raise InputError(f"there is no edge {shown(entry)}")
    return tuple((source, index) for index in labels)


def find_doors(raw: Any, space: Space) -> tuple[int, ...]:
    """Return the indices of doors, in the order given.

    Raises:
        InputError: it is no list, or a door is not there.
    """
    known = [door.name for door in space.doors]
    if not isinstance(raw, tuple):
        raise InputError(f"expected a list of doors, got {shown(raw)}")
    for name in raw:
        if name not in known:
            raise InputError(f"unknown door {shown(name)}{suggestion(str(name), known)}")
    return tuple(known.index(name) for name in raw)


def _edge_end(raw: Any, space: Space) -> int:
    refs = parse_location_set(raw)
    if isinstance(refs, Box) or len(refs) != 1:
        raise InputError(f"expected a location as end of an edge, got {shown(raw)}")
    return find_location(refs[0], space)


def present(of: ParameterType, value: Any, space: Space) -> Any:
    """Return the form that a file would give `value`: names, `[row, col]`, numbers."""
    if of.name == "location":
        return _present_location(value, space)
    if of.name == "locations":
        return [_present_location(index, space) for index in value]
    if of.name == "doors":
        return [space.doors[index].name for index in value]
    if of.name == "edges":
        return [
            [
                _present_location(source, space),
                _present_location(int(space.target[source, label]), space),
                space.moves[label],
            ]
            for source, label in value
        ]
    return of.present(value)


def _present_location(index: int, space: Space) -> str | list[int]:
    if space.shape is None:
        return space.locations[index]
    return list(divmod(index, space.shape[1]))


def present_all(types: ParameterTypes, values: Values, space: Space) -> dict[str, Any]:
    """Return name -> value as a file would give it, in declared order."""
    return {name: present(of, values[name], space) for name, of in types.items()}


def constants(
    concern: ConcernName, types: ParameterTypes, values: Values, space: Space
) -> dict[str, Value | Table]:
    """Return what expressions read of the parameters, by resolved names; locations as a table bool [P]."""
    readable: dict[str, Value | Table] = {}
    for name, of in types.items():
        value = values[name]
        if of.holds_locations:
            mask = np.zeros(space.num_locations, dtype=np.bool_)
            mask[list(held_locations(values, name))] = True
            readable[parameter_name(concern, name)] = Table("", Column.of(mask), meaning=f"at({name})")
        elif isinstance(value, bool | Fraction):
            readable[parameter_name(concern, name)] = value
    return readable


def parameter_name(concern: ConcernName, name: str) -> str:
    """Return what a parameter is called in resolved expressions."""
    return f"{concern}.{name}"


def held_locations(values: Values, parameter: str) -> tuple[int, ...]:
    """Return the locations that a parameter holds; none if there is no such parameter."""
    held: Any = values.get(parameter, ())
    return held if isinstance(held, tuple) else (held,)
