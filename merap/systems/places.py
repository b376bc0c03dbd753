"""The locations of a simulated system, for what only a system with a space has.

Axes: S states, P locations.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from merap.concerns.combination import Combination, DeclaredCombination
from merap.mdp.matching import match_rows
from merap.mdp.model import Ints, TabularMDP


def spatial(combination: Combination) -> DeclaredCombination | None:
    """Return a combination whose system has a location; None: it has none."""
    if isinstance(combination, DeclaredCombination) and combination.program.location:
        return combination
    return None


def location_in(combination: DeclaredCombination, values: Mapping[str, int]) -> int:
    """Return the index of the location in a state, given the values of its variables."""
    here = np.array([[values[name] for name in combination.program.location]])
    return int(match_rows(here, combination.space.valuations)[0])


def locations_in(combination: DeclaredCombination, model: TabularMDP) -> Ints:
    """Return int64 [S], the index of the location in every state of a model."""
    columns = [model.variable_names.index(name) for name in combination.program.location]
    return match_rows(model.valuations[:, columns], combination.space.valuations)


def leaves_open(combination: Combination, values: Mapping[str, int]) -> bool:
    """Tell whether a combination leaves the location in a state open; true where there is no location."""
    located = spatial(combination)
    if located is None:
        return True
    closed = located.environment.blocked | located.capability.no_entry
    return not closed[location_in(located, values)]
