"""Draw the locations of a map and what a combination says about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle, Patch, Rectangle

from merap.concerns.combination import DeclaredCombination
from merap.concerns.space import Space
from merap.mdp.matching import match_rows
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import GOAL_LABEL, UNSAFE_LABEL
from merap.program.expressions import Constant, evaluate_where_defined, variables
from merap.program.form import Program
from merap.program.states import Encoding, States
from merap.report.colouring import Colouring
from merap.report.doors import door_middles
from merap.report.extent import Extent, name_sizes
from merap.report.labels import place_labels
from merap.report.sheet import Panel
from merap.report.style import (
    GREEN,
    INK,
    LEGEND_MARK,
    PALE,
    PURPLE,
    SKY_BLUE,
    WALL,
    YELLOW,
    Entry,
    heading,
    mark,
    write,
)

_POINTS_PER_EDGE = 25
START = "start"
LABELS = (GOAL_LABEL, UNSAFE_LABEL)


@dataclass(frozen=True)
class Layer:
    """A marker on a location.

    Attributes:
        marker: marker of matplotlib.
        colour: colour of its face, `none` for an outline.
        edge: colour of its outline.
        size: in diameters of the location.
        width: width of the outline, in diameters of the location.
        z: markers with a higher one cover it; circles have 3.
        shift: shift of the centre to the right and upwards, in radii.
    """

    marker: str
    colour: str
    edge: str
    size: float
    width: float
    z: float
    shift: tuple[float, float] = (0.0, 0.0)


def _reach(layer: Layer) -> float:
    """Return how far a mark reaches from the centre of a location, in radii."""
    return layer.size + max(layer.shift)


_CROSS = Layer("x", "white", "white", 0.45, 0.09, 4)
_BAR = Layer("_", "white", "white", 0.6, 0.16, 4)
_ON_GRAPH = {
    START: (Layer("s", SKY_BLUE, INK, 1.5, 0.05, 2),),
    GOAL_LABEL: (Layer("*", GREEN, INK, 2.3, 0.05, 2),),
    "blocked (environment)": (Layer("o", WALL, INK, 1.0, 0.05, 3.5), _CROSS),
    "no entry (capability)": (Layer("o", PURPLE, INK, 1.0, 0.05, 3.6), _BAR),
    UNSAFE_LABEL: (Layer("^", YELLOW, INK, 0.6, 0.07, 4, (0.8, 0.8)),),
}
_ON_GRID = {
    START: (Layer("s", "none", SKY_BLUE, 0.78, 0.11, 3.5),),
    GOAL_LABEL: (Layer("*", GREEN, INK, 0.66, 0.03, 3.6),),
    "blocked (environment)": (Layer("s", WALL, WALL, 0.9, 0.0, 3.5), _CROSS),
    "no entry (capability)": (Layer("s", PURPLE, PURPLE, 0.9, 0.0, 3.6), _BAR),
    UNSAFE_LABEL: (Layer("^", YELLOW, INK, 0.28, 0.03, 4, (0.58, 0.58)),),
}


def draw_locations(panel: Panel, colouring: Colouring, mdp: TabularMDP) -> list[Entry]:
    """Draw locations as circles or cells, with start, goal, blocked, no entry and unsafe, and their names.

    Args:
        panel: where to.
        colouring: colours of the locations.
        mdp: the model of the combination.
    """
    _draw_faces(panel, colouring)
    combination = panel.combination
    start = np.zeros(combination.space.num_locations, dtype=np.bool_)
    start[locations_of(combination, mdp)[mdp.initial > 0]] = True
    masks = {
        START: start,
        GOAL_LABEL: label_locations(combination, mdp, GOAL_LABEL),
        "blocked (environment)": combination.environment.blocked,
        "no entry (capability)": combination.capability.no_entry,
        UNSAFE_LABEL: label_locations(combination, mdp, UNSAFE_LABEL) & ~combination.environment.blocked,
    }
    styles = _ON_GRID if panel.extent.is_grid else _ON_GRAPH
    entries = [heading("Locations")]
    for meaning, mask in masks.items():
        if mask.any():
            _draw_mark(panel, mask, styles[meaning], meaning)
            somewhen = meaning in LABELS and not _of_locations(combination.program, meaning)
            entries.append(_entry(styles[meaning], f"{meaning} (in some states)" if somewhen else meaning))
    _draw_names(panel, masks)
    return entries


def locations_of(combination: DeclaredCombination, mdp: TabularMDP) -> Ints:
    """int64 [S], the location of each state; -1 for one that has none."""
    space = combination.space
    columns = [mdp.variable_names.index(name) for name in space.variable_names]
    return match_rows(mdp.valuations[:, columns], space.valuations)


def label_locations(combination: DeclaredCombination, mdp: TabularMDP, label: str) -> Bools:
    """Return bool [P], where a label holds: by its definition, or in some state of the model.

    The definition counts where it reads nothing but the location, so that places are found that a
    combination can't reach.
    """
    program, space = combination.program, combination.space
    if _of_locations(program, label):
        condition = program.labels.get(label, Constant(False))
        encoding = Encoding(tuple(one for one in program.variables if one.name in program.location))
        holds, defined = evaluate_where_defined(condition, States(encoding, encoding.codes(space.valuations)))
        return np.broadcast_to(holds & defined, space.num_locations)
    found = locations_of(combination, mdp)[mdp.labels[label]]
    return np.bincount(found, minlength=space.num_locations) > 0


def _of_locations(program: Program, label: str) -> bool:
    """Return whether the definition of a label reads nothing but the location."""
    condition = program.labels.get(label, Constant(False))
    return {one.name for one in variables(condition)} <= set(program.location)


def _draw_faces(panel: Panel, colouring: Colouring) -> None:
    edge = PALE if panel.extent.is_grid else INK
    for mask, hatch in ((~colouring.dotted, None), (colouring.dotted, "....")):
        shapes = [_shape(panel.extent, position) for position in panel.combination.space.positions[mask]]
        # The hatch takes its colour from the edge where none is given.
        collection = PatchCollection(
            shapes, facecolors=colouring.face[mask], edgecolors=edge, linewidths=1.0, hatch=hatch, zorder=3
        )
        collection.set_gid("locations")
        panel.axes.add_collection(collection)


def _shape(extent: Extent, position: Floats) -> Patch:
    x, y = position
    if extent.is_grid:
        return Rectangle((x - extent.radius, y - extent.radius), 2 * extent.radius, 2 * extent.radius)
    return Circle((x, y), extent.radius)


def _draw_mark(panel: Panel, mask: Bools, layers: tuple[Layer, ...], meaning: str) -> None:
    diameter = 2 * panel.extent.radius_in_points
    for layer in layers:
        shift = np.array(layer.shift) * panel.extent.radius
        points = panel.combination.space.positions[mask] + shift
        panel.axes.plot(
            points[:, 0],
            points[:, 1],
            linestyle="none",
            marker=layer.marker,
            markersize=layer.size * diameter,
            markerfacecolor=layer.colour,
            markeredgecolor=layer.edge,
            markeredgewidth=layer.width * diameter,
            zorder=layer.z,
            gid=meaning,
        )


def _entry(layers: tuple[Layer, ...], meaning: str) -> Entry:
    largest = max(layer.size for layer in layers)
    marks = []
    for layer in layers:
        size = layer.size / largest
        thick = mark(layer.marker, layer.colour, edge=layer.edge, size=size)
        thick.set_markeredgewidth(layer.width / largest * LEGEND_MARK)
        marks.append(thick)
    return tuple(marks), meaning


def _draw_names(panel: Panel, masks: Mapping[str, Bools]) -> None:
    """Write the names beside their locations and marks; on a grid number rows and columns instead."""
    space, extent = panel.combination.space, panel.extent
    if extent.is_grid:
        _number_cells(panel.axes, space)
        return
    if extent.name_size == 0:
        return
    names = (*space.locations, *(door.name for door in space.doors))
    sizes = name_sizes(names, extent.name_size)
    steps = np.linspace(0, 1, _POINTS_PER_EDGE)[:, None, None]
    pieces = [np.stack([line[:-1], line[1:]]) for line in panel.lines.lines]
    first, second = np.concatenate(pieces, axis=1) if pieces else np.zeros((2, 0, 2))
    points = ((1 - steps) * first + steps * second).reshape(-1, 2)
    reach = np.full(space.num_locations, 1.15)
    for meaning, mask in masks.items():
        reach[mask] = np.maximum(reach[mask], max(_reach(layer) for layer in _ON_GRAPH[meaning]))
    radii = np.append(reach, np.ones(len(space.doors))) * extent.radius * extent.scale
    anchors = np.concatenate([space.positions, door_middles(panel)])
    page = (extent.low * extent.scale, extent.high * extent.scale)
    places = place_labels(anchors * extent.scale, radii, sizes, points * extent.scale, page)
    for name, (x, y) in zip(names, places / extent.scale, strict=True):
        write(panel.axes, x, y, name, size=extent.name_size)


def _number_cells(axes: Axes, space: Space) -> None:
    assert space.shape is not None
    rows, columns = space.shape
    grid = space.positions.reshape(rows, columns, 2)
    every = 1 if max(rows, columns) <= 30 else 10
    axes.set_xticks(grid[0, ::every, 0], [str(column) for column in range(0, columns, every)])
    axes.set_yticks(grid[::every, 0, 1], [str(row) for row in range(0, rows, every)])
    axes.tick_params(length=0, labelsize=8, labelcolor=INK, pad=2)
    axes.xaxis.tick_top()
    axes.xaxis.set_label_position("top")
    axes.set_xlabel("column", fontsize=8, color=INK, labelpad=2)
    axes.set_ylabel("row", fontsize=8, color=INK, labelpad=2)
