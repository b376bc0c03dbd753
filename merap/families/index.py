"""The index of a case's members: which states it holds.

Axes: V variables.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import prod

import numpy as np

from merap.families.observation import VariableKind, variable_kind
from merap.mdp.index import FamilyIndex, new_index
from merap.mdp.model import Ints, TabularMDP
from merap.program.form import Program, StateVariable

# All valuations are on the index if those that members reach are no less than this part of them.
SPARSE = 4


def family_index(
    kinds: Sequence[VariableKind], actions: tuple[str, ...], models: Sequence[TabularMDP]
) -> FamilyIndex:
    """Return the index of some members of a family.

    After the completed states it holds every valuation of the variables, if members reach at least one in
    `SPARSE` of them, so that other members are likely to be on it, too; else those that members reach.

    Args:
        kinds: V kinds of the variables.
        actions: declared names, without `end`.
        models: whole models of the members.

    Raises:
        ModelError: a model has other variables or no label `done`.
    """
    names = tuple(kind.name for kind in kinds)
    index = new_index(names, actions).extended(*models)
    sizes = [kind.high - kind.low + 1 for kind in kinds]
    if prod(sizes) > SPARSE * (index.num_states - len(index.completed)):
        return index
    lows = np.array([kind.low for kind in kinds], dtype=np.int64)
    valuations: Ints = lows + np.stack(np.unravel_index(np.arange(prod(sizes)), sizes), axis=1)
    return new_index(names, actions, valuations, index.completed)


def index_kinds(programs: Iterable[Program]) -> tuple[VariableKind, ...]:
    """Return the kinds of the variables that tell the states of programs of one family apart.

    These are all variables but the flag, which is false in every state that is not complete. A kind's range
    is that of all programs together.
    """
    found: dict[str, VariableKind] = {}
    for program in programs:
        for variable in telling_variables(program):
            kind = variable_kind(variable)
            known = found.setdefault(kind.name, kind)
            found[kind.name] = replace(known, low=min(known.low, kind.low), high=max(known.high, kind.high))
    return tuple(found.values())


def telling_variables(program: Program) -> tuple[StateVariable, ...]:
    """Return the variables that tell states apart: all but the flag, where there are others."""
    return tuple(one for one in program.variables if one.name != program.flag) or program.variables
