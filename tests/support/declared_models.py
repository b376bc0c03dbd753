"""Models of case files as plain Python, on which exploration and Storm agree."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from merap.families.loading import load_case
from merap.families.models import built, explored
from merap.mdp.comparison import compare
from tests.support.case_examples import write_case

Successors = dict[str, dict[tuple[Any, ...], float]]


def successors(
    folder: Path, text: str, system: str, names: tuple[str, ...]
) -> dict[tuple[Any, ...], Successors]:
    """Return state -> action -> successor -> probability.

    Args:
        folder: for the case file.
        text: the case file.
        system: a member, or a system that is met.
        names: all variables but `done`, in the order wanted; values are numbers.
    """
    combination = load_case(write_case(folder, text)).system(system)
    mdp = explored(combination)
    compare(built(combination), mdp).require_same()
    assert {*mdp.variable_names} == {*names, "done"}
    kept = [mdp.variable_names.index(name) for name in names]
    states = [tuple(row) for row in mdp.valuations[:, kept].tolist()]
    found: dict[tuple[Any, ...], Successors] = {state: {} for state in states}
    for choice in range(mdp.num_choices):
        action = mdp.action_names[mdp.choice_action[choice]]
        branches = range(*mdp.choice_to_branch[choice : choice + 2])
        found[states[mdp.choice_state[choice]]][action] = {
            states[mdp.branch_target[one]]: float(mdp.branch_prob[one]) for one in branches
        }
    return found
