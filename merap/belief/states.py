"""How a belief numbers states: location and mode, p * Q + q, and behind them all one completed state.

Axes: P locations, Q modes.
"""

from __future__ import annotations

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.mdp.index import FamilyIndex, values_below
from merap.mdp.model import Floats
from merap.mdp.reserved_names import MODE_VARIABLE


def belief_states(combination: DeclaredCombination) -> FamilyIndex:
    """Return the index of the belief, P Q + 1 states."""
    locations = np.repeat(combination.space.valuations, len(combination.modes), axis=0)
    modes = np.tile(np.arange(len(combination.modes)), combination.space.num_locations)
    pairs = np.column_stack([locations, modes])
    names = (*combination.space.variable_names, MODE_VARIABLE)
    table = np.vstack([pairs, values_below(pairs, 1)])
    return FamilyIndex(names, table, {frozenset(): len(pairs)}, combination.actions)


def start_of(combination: DeclaredCombination) -> Floats:
    """Return float64 [P Q], where an episode begins."""
    initial = np.zeros((combination.space.num_locations, len(combination.modes)))
    initial[:, combination.capability.initial_mode] = combination.objective.start
    return initial.ravel()
