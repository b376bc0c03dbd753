"""Combinations, and pairs of environment and capability, as Storm builds them from their text."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.checker.storm import StormModel, build_text
from merap.concerns.combination import Combination
from merap.mdp.matching import match_rows
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.prism.rendering import render, render_pair


@dataclass(frozen=True, eq=False)
class BuiltModel:
    """A model in Storm and the same as arrays, in Storm's numbering of states.

    Attributes:
        storm: for checking and exporting.
        mdp: its arrays; the start distribution is the objective's.
    """

    storm: StormModel
    mdp: TabularMDP


def build_combination(combination: Combination) -> BuiltModel:
    """Render a combination, build it with Storm and check that it is sound.

    Raises:
        ModelError: it is not.
        EngineError: Storm failed.
    """
    storm = build_text(render(combination), combination.name)
    built = storm.mdp()
    return BuiltModel(storm, replace(built, initial=_start_distribution(combination, built)))


def build_pair(combination: Combination, starts: Bools) -> TabularMDP:
    """Environment and capability of a combination, built by Storm without an objective.

    Args:
        combination: whose objective does not matter.
        starts: bool [P], all locations an episode may begin in; equally likely in the result.
    """
    name = f"{combination.environment.name}.{combination.capability.name}"
    return build_text(render_pair(combination, starts), name).mdp(reward=None)


def _start_distribution(combination: Combination, built: TabularMDP) -> Floats:
    """float64 [S]: PRISM's language has initial states without weights, the objective has weights."""
    starts = np.flatnonzero(combination.objective.start)
    columns = [built.variable_names.index(name) for name in combination.space.variable_names]
    initial_states = np.flatnonzero(built.initial)
    row = match_rows(combination.space.valuations[starts], built.valuations[initial_states][:, columns])
    weights = np.zeros(built.num_states)
    weights[initial_states[row]] = combination.objective.start[starts]
    return weights
