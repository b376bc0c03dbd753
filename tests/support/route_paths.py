"""Paths that are written down by hand."""

from __future__ import annotations

from collections.abc import Sequence

from merap.concerns.combination import Combination
from merap.report.path import Ending, RoutePath


def written_path(
    combination: Combination,
    steps: Sequence[tuple[int, str]],
    last: int,
    ending: Ending = "open",
    label: str = "path",
) -> RoutePath:
    """Return a path of pairs of a location and the action taken there, to a last location."""
    locations = (*(location for location, _ in steps), last)
    names = tuple(combination.space.locations[location] for location in locations)
    return RoutePath(locations, names, tuple(action for _, action in steps), (), ending, label)
