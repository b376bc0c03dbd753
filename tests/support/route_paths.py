"""Paths that are written down by hand."""

from __future__ import annotations

from collections.abc import Sequence

from merap.concerns.combination import DeclaredCombination
from merap.report.path import Ending, RoutePath


def written_path(
    combination: DeclaredCombination,
    steps: Sequence[tuple[int, str]],
    last: int,
    ending: Ending = "open",
    label: str = "path",
) -> RoutePath:
    """Return a path of pairs of a location and the action taken there, to a last location."""
    places = tuple(combination.space.locations[location] for location in (*(one for one, _ in steps), last))
    return RoutePath(places, ("",) * len(places), tuple(action for _, action in steps), ending, label)
