"""Resolve the `space` of the case file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from merap.concerns.document import Document, KeyPath
from merap.concerns.parameters import find_location, find_locations
from merap.concerns.reserved_words import check_readable_name
from merap.concerns.schema_base import LocationSet, Setting, is_number, shown
from merap.concerns.schema_capability import STAY
from merap.concerns.schema_space import AttributeSpec, DoorSpec, GridSpec, SpaceSpec
from merap.concerns.space import NO_SPACE, Attribute, Detector, Door, Space
from merap.errors import InputError
from merap.mdp.model import Floats, Ints
from merap.program.names import check_name, suggestion

_DEFAULT_RANGES = {"bool": (0.0, 1.0), "int": (-np.inf, np.inf), "real": (-np.inf, np.inf)}


def resolve_space(document: Document, spec: SpaceSpec | None) -> Space:
    """Resolve the space, with every attribute at its default values; without one there is one place.

    Raises:
        InputError: a name is illegal, an edge leads nowhere or stands twice, a value is out of range, or
            a door is between locations that no edge connects.
    """
    if spec is None:
        return NO_SPACE
    bare = _grid(document, spec.grid) if spec.grid is not None else _graph(document, spec)
    attributes = tuple(_attribute(document, bare, name, entry) for name, entry in spec.attributes.items())
    return replace(
        bare,
        attributes=attributes,
        detectors=_detectors(document, spec, attributes),
        doors=tuple(_door(document, bare, name, entry) for name, entry in spec.doors.items()),
    )


def _detectors(
    document: Document, spec: SpaceSpec, attributes: tuple[Attribute, ...]
) -> tuple[Detector, ...]:
    ranges = {one.name: (one.low, one.high) for one in attributes}
    for name, entry in spec.detectors.items():
        with document.at("space", "detectors", name):
            check_name(name, "a detector")
        known = ["blocked", *spec.attributes]
        if entry.of not in known:
            raise document.error(
                ("space", "detectors", name, "of"),
                f"a detector can't see {entry.of!r}{suggestion(entry.of, known)}",
            )
        if not np.all(np.isfinite(ranges.get(entry.of, (0, 1)))):
            raise document.error(
                ("space", "attributes", entry.of),
                f"key 'range' is missing: the detector {name} reads this attribute",
            )
    return tuple(
        Detector(name, entry.of, entry.range, entry.accuracy) for name, entry in spec.detectors.items()
    )


def _door(document: Document, space: Space, name: str, spec: DoorSpec) -> Door:
    with document.at("space", "doors", name, "between"):
        one, other = (find_location(ref, space) for ref in spec.between)
        edges = np.zeros(space.target.shape, dtype=np.bool_)
        edges[one] = space.target[one] == other
        edges[other] |= space.target[other] == one
        if not edges.any():
            raise InputError(f"no edge connects {space.locations[one]} and {space.locations[other]}")
    edges.flags.writeable = False
    return Door(name, edges)


def check_label(label: str) -> None:
    """Refuse an edge label that is no name.

    Raises:
        InputError: it is no identifier, or `stay`.
    """
    check_name(label, "an edge label")
    if label == STAY:
        raise InputError(f"illegal name {STAY!r} of an edge label: outcomes use it for staying")


def _grid(document: Document, spec: GridSpec) -> Space:
    cells = [(row, col) for row in range(spec.rows) for col in range(spec.cols)]
    rows, cols = np.array(cells, dtype=np.int64).T
    target = np.full((len(cells), len(spec.moves)), -1, dtype=np.int64)
    for label, (name, (down, right)) in enumerate(spec.moves.items()):
        with document.at("space", "grid", "moves", name):
            check_label(name)
            if down == 0 and right == 0:
                raise InputError("a move of [0, 0] leads nowhere; use the outcome stay")
        row, col = rows + down, cols + right
        inside = (row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols)
        target[inside, label] = (row * spec.cols + col)[inside]
    return _bare(
        locations=tuple(f"r{row}c{col}" for row, col in cells),
        positions=np.stack([cols, -rows], axis=1).astype(np.float64),
        moves=tuple(spec.moves),
        target=target,
        shape=(spec.rows, spec.cols),
    )


def _graph(document: Document, spec: SpaceSpec) -> Space:
    assert spec.locations is not None
    assert spec.edges is not None
    for name in spec.locations:
        with document.at("space", "locations", name):
            check_name(name, "a location")
    locations = tuple(spec.locations)
    index = {name: number for number, name in enumerate(locations)}
    moves = tuple(dict.fromkeys(label for _, _, label in spec.edges))
    target = np.full((len(locations), len(moves)), -1, dtype=np.int64)
    labels = {label: number for number, label in enumerate(moves)}
    for number, (source, end, label) in enumerate(spec.edges):
        path = ("space", "edges", number)
        for part, name in enumerate((source, end)):
            if name not in index:
                raise document.error(
                    (*path, part),
                    f"an edge to nowhere: unknown location {name!r}{suggestion(name, locations)}",
                )
        with document.at(*path, 2):
            check_label(label)
        if target[index[source], labels[label]] >= 0:
            raise document.error(path, f"there are two edges from {source} with the label {label!r}")
        target[index[source], labels[label]] = index[end]
    positions = np.array(list(spec.locations.values()), dtype=np.float64)
    return _bare(locations, positions, moves, target, shape=None)


def _bare(
    locations: tuple[str, ...],
    positions: Floats,
    moves: tuple[str, ...],
    target: Ints,
    shape: tuple[int, int] | None,
) -> Space:
    positions.flags.writeable = False
    target.flags.writeable = False
    return Space(locations, positions, moves, target, shape, (), ())


def _attribute(document: Document, space: Space, name: str, spec: AttributeSpec) -> Attribute:
    path = ("space", "attributes", name)
    with document.at(*path):
        check_readable_name(name, "an attribute")
    assert spec.type is not None
    low, high = spec.range or _DEFAULT_RANGES[spec.type]
    default = False if spec.type == "bool" and spec.default is None else spec.default
    values = np.full(space.num_locations, np.nan)
    if default is not None:
        with document.at(*path, "default"):
            values[:] = attribute_value(spec.type, low, high, default)
    attribute = apply_settings(
        document,
        (*path, "values"),
        Attribute(name, spec.type, low, high, values),
        spec.values,
        find=lambda refs: find_locations(refs, space),
        parameters={},
    )
    unset = np.flatnonzero(np.isnan(attribute.values))
    if len(unset):
        raise document.error(
            path, f"key 'default' is missing: location {space.locations[unset[0]]} has no value"
        )
    return attribute


def apply_settings(
    document: Document,
    path: KeyPath,
    attribute: Attribute,
    settings: tuple[Setting, ...],
    *,
    find: Callable[[LocationSet], tuple[int, ...]],
    parameters: Mapping[str, Any],
) -> Attribute:
    """Set some values of an attribute; later settings win.

    Args:
        document: where errors are placed.
        path: where `settings` stand.
        attribute: as it is without them.
        settings: locations and values.
        find: gives the indices of a setting's locations.
        parameters: what a text as value stands for.

    Raises:
        InputError: a location or parameter is unknown or a value not allowed.
    """
    values = attribute.values.copy()
    for setting in settings:
        with document.at(*path, *setting.path):
            value = setting.value
            if isinstance(value, str):
                if value not in parameters:
                    raise InputError(f"unknown parameter {value!r}{suggestion(value, parameters)}")
                value = parameters[value]
            number = attribute_value(attribute.kind, attribute.low, attribute.high, value)
            values[list(find(setting.at))] = number
    values.flags.writeable = False
    return Attribute(attribute.name, attribute.kind, attribute.low, attribute.high, values)


def attribute_value(kind: str, low: float, high: float, value: Any) -> float:
    """Return the number that stands for a value of an attribute.

    Raises:
        InputError: it has another type or is out of range.
    """
    if kind == "bool":
        if not isinstance(value, bool):
            raise InputError(f"expected true or false, got {shown(value)}")
        return float(value)
    if not is_number(value) or (kind == "int" and value != int(value)) or not low <= value <= high:
        what = "a whole number" if kind == "int" else "a number"
        limits = f" from {low:g} to {high:g}" if np.isfinite(high) else ""
        raise InputError(f"expected {what}{limits}, got {shown(value)}")
    return float(value)
