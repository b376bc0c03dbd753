"""Have Storm build combinations, and pairs of environment and capability, from their text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from merap.checker.model_text import model_text
from merap.checker.storm import StormModel, build_text, build_weighted
from merap.concerns.combination import Combination
from merap.mdp.model import Bools, TabularMDP
from merap.prism.rendering import render_pair
from merap.prism.text_names import text_names


@dataclass(frozen=True, eq=False)
class BuiltModel:
    """A model in Storm and the same as arrays, in Storm's numbering of states and the names of the program.

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
    names = text_names(combination.program)
    arrays = replace(
        storm.arrays,
        initial=initial,
        variable_names=_as_in_program(storm.arrays.variable_names, names.variables),
        action_names=_as_in_program(storm.arrays.action_names, names.actions),
    )
    return BuiltModel(storm, arrays)


def _as_in_program(written: tuple[str, ...], names: Mapping[str, str]) -> tuple[str, ...]:
    own = {text: name for name, text in names.items()}
    return tuple(own.get(name, name) for name in written)


def build_pair(combination: Combination, starts: Bools) -> TabularMDP:
    """Build environment and capability of a combination without an objective.

    Args:
        combination: whose objective does not matter.
        starts: bool [P], all locations an episode may begin in; equally likely in the result.
    """
    name = f"{combination.environment.name}.{combination.capability.name}"
    return build_text(render_pair(combination, starts), name).mdp(reward=None)
