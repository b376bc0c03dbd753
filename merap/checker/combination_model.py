"""Have Storm build combinations, and pairs of environment and capability, from their text."""

from __future__ import annotations

from dataclasses import dataclass, replace

from merap.checker.model_text import model_text
from merap.checker.storm import StormModel, build_text, build_weighted
from merap.concerns.combination import Combination
from merap.mdp.model import Bools, TabularMDP
from merap.prism.rendering import render_pair


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
    storm, initial = build_weighted(model_text(combination))
    return BuiltModel(storm, replace(storm.arrays, initial=initial))


def build_pair(combination: Combination, starts: Bools) -> TabularMDP:
    """Build environment and capability of a combination without an objective.

    Args:
        combination: whose objective does not matter.
        starts: bool [P], all locations an episode may begin in; equally likely in the result.
    """
    name = f"{combination.environment.name}.{combination.capability.name}"
    return build_text(render_pair(combination, starts), name).mdp(reward=None)
