"""Have Storm build combinations from their text."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from merap.checker.model_text import model_text
from merap.checker.storm import build_text, build_weighted
from merap.checker.storm_model import StormModel
from merap.concerns.combination import Combination
from merap.mdp.model import TabularMDP
from merap.mdp.umb_names import rename_umb
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
    own = text_names(combination.program).back
    arrays = replace(
        storm.arrays,
        initial=initial,
        variable_names=tuple(own.variables.get(name, name) for name in storm.arrays.variable_names),
        action_names=tuple(own.actions.get(name, name) for name in storm.arrays.action_names),
    )
    return BuiltModel(storm, arrays)


def export_combination(combination: Combination, path: Path) -> None:
    """Render a combination, build it with Storm and write what Storm has as UMB, in the program's names.

    Raises:
        ModelError: it is not sound.
        EngineError: Storm failed.
    """
    build_text(model_text(combination).text, combination.name).export_umb(path)
    own = text_names(combination.program).back
    if own.actions or own.variables:
        rename_umb(path, own.actions, own.variables)
