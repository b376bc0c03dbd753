"""What every part of a map is drawn on and from."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.axes import Axes

from merap.concerns.combination import Combination
from merap.report.extent import Extent
from merap.report.geometry import EdgeLines


@dataclass(frozen=True, eq=False)
class Panel:
    """One map of a page.

    Attributes:
        axes: to draw on, in the units of the positions.
        extent: what it shows and how large.
        lines: along which edges run.
        combination: what it shows.
    """

    axes: Axes
    extent: Extent
    lines: EdgeLines
    combination: Combination
