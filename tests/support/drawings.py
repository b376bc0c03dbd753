"""Read what has been drawn: artists by the name that they were drawn under, and the legend."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from merap.mdp.model import Floats


def named(axes: Axes, name: str) -> list[Any]:
    """Return the artists drawn under a name, which are of many kinds."""
    return [artist for artist in axes.get_children() if artist.get_gid() == name]


def only(axes: Axes, name: str) -> Any:
    (artist,) = named(axes, name)
    return artist


def polygons(axes: Axes, name: str) -> list[Floats]:
    return [path.vertices[:-1] for path in only(axes, name).get_paths()]


def points(axes: Axes, name: str) -> Floats:
    """Where a mark stands, float64 [M, 2]: the places of its uppermost layer."""
    places: Floats = named(axes, name)[-1].get_xydata()
    return places


def legend_of(figure: Figure) -> list[str]:
    (legend,) = figure.legends
    return [text.get_text().strip() for text in legend.get_texts()]
