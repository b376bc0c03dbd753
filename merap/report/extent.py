"""Choose the part of the plane that a map shows, and one scale for positions, circles and text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.textpath import TextPath

from merap.concerns.space import Space
from merap.mdp.model import Floats
from merap.report.geometry import spacing_of
from merap.report.style import FONT_SIZE

_LARGEST = np.array([11.0, 8.0])
_SMALLEST_WIDTH = 4.5
_CELL = 0.52
_NEIGHBOURS_APART = 0.95
_RADIUS = 0.15
_RADIUS_PART = 0.3
# Names of more locations than this can't be read on one page.
_MOST_NAMES = 150


@dataclass(frozen=True, eq=False)
class Extent:
    """The part of the plane a map shows.

    Attributes:
        low: float64 [2], least x and y.
        high: float64 [2], greatest x and y.
        scale: inches per unit of the positions.
        spacing: least distance of two locations; on a grid the side of a cell.
        radius: radius of a location's circle, in units of the positions; on a grid half a cell.
        is_grid: locations are cells that touch.
        name_size: in points; 0 shows no names.
    """

    low: Floats
    high: Floats
    scale: float
    spacing: float
    radius: float
    is_grid: bool
    name_size: float

    @property
    def inches(self) -> Floats:
        """float64 [2], width and height on paper."""
        size: Floats = (self.high - self.low) * self.scale
        return size

    @property
    def radius_in_points(self) -> float:
        """Of a location's circle on paper."""
        return self.radius * self.scale * 72


def extent_of(space: Space) -> Extent:
    """Choose scale and margins so that names can be read and the map fits on a page."""
    spacing = spacing_of(space.positions)
    low, high = space.positions.min(axis=0), space.positions.max(axis=0)
    if space.shape is not None:
        half = spacing / 2
        scale = min(_CELL / spacing, float((_LARGEST / (high - low + spacing)).min()))
        return Extent(low - half, high + half, scale, spacing, half, True, 0.0)
    size = np.maximum(high - low, spacing / 2)
    # Where few locations are close to each other the map may grow, but never over the page.
    scale = max(_NEIGHBOURS_APART / spacing, _SMALLEST_WIDTH / float(size.max()))
    scale = min(scale, float((_LARGEST / size).min()))
    radius = min(_RADIUS / scale, _RADIUS_PART * spacing)
    name_size = 0.0 if space.num_locations > _MOST_NAMES else min(FONT_SIZE, 34 * spacing * scale)
    margin = _margin(space, radius * scale, name_size) / scale
    return Extent(low - margin, high + margin, scale, spacing, radius, False, name_size)


def _margin(space: Space, radius: float, name_size: float) -> Floats:
    """Return inches around the outermost locations: half a name to the sides, a whole one above."""
    if name_size == 0:
        return np.array([2 * radius, 2 * radius])
    sizes = name_sizes(space.locations, name_size)
    return np.array([max(sizes[:, 0].max() / 2, 2.2 * radius), 2.2 * radius + sizes[:, 1].max()]) + 0.08


def name_sizes(names: tuple[str, ...], size: float) -> Floats:
    """Return float64 [P, 2], width and height of each name in inches."""
    widths = [TextPath((0, 0), name, size=size, usetex=False).get_extents().width for name in names]
    return np.stack([np.array(widths), np.full(len(names), 1.15 * size)], axis=1) / 72
