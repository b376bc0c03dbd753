"""The model of a combination by two routes: Storm's from the whole text, and our own exploration."""

from __future__ import annotations

from dataclasses import replace

from merap.checker.combination_model import build_combination
from merap.concerns.combination import Combination
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import OBJECTIVE_REWARD
from merap.program.arrays import tabular
from merap.program.exploration import explore


def built(combination: Combination) -> TabularMDP:
    """Return the model that Storm builds from the whole text, with the labels of the program alone.

    Raises:
        ModelError: it is unsound.
        EngineError: Storm failed.
    """
    model = build_combination(combination).mdp
    labels = {name: mask for name, mask in model.labels.items() if name in combination.program.labels}
    return replace(model, labels=labels)


def explored(combination: Combination) -> TabularMDP:
    """Return the model that our own exploration finds, with the reward of each single step.

    Raises:
        InputError: the parts of the combination do not compose to a program.
        ModelError: a reachable state has no action, or something is undefined there.
    """
    program = combination.program
    return tabular(program, explore(program), reward=OBJECTIVE_REWARD)
