"""The nodes of a state diagram: joint values of some variables; long ranges are shortened.

Axes: S states, V variables, D nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.mdp.matching import row_keys
from merap.mdp.model import Ints, TabularMDP
from merap.program.form import StateVariable

# A diagram with more nodes can't be read.
MAX_NODES = 8
# Values at each end of a longer range that are nodes of their own.
_KEPT = 3


@dataclass(frozen=True, eq=False)
class Nodes:
    """Where each state is in a diagram.

    Attributes:
        values: int64 [S, V], of the diagram's variables.
        of_state: int64 [S], its node.
        texts: D texts, in the order of the values.
    """

    values: Ints
    of_state: Ints
    texts: tuple[str, ...]


def joint_nodes(mdp: TabularMDP, variables: Sequence[StateVariable]) -> Nodes | None:
    """Return the joint values that occur; None: there are more than `MAX_NODES`."""
    values = _values(mdp, variables)
    _, first, of_state = np.unique(row_keys(values)[0], return_index=True, return_inverse=True)
    if len(first) > MAX_NODES:
        return None
    texts = (
        ", ".join(one.text(value) for one, value in zip(variables, row, strict=True))
        for row in values[first].tolist()
    )
    return Nodes(values, of_state, tuple(texts))


def value_nodes(mdp: TabularMDP, variable: StateVariable) -> Nodes:
    """Return the values of a variable that occur; of many, those between the ends are one node."""
    values = _values(mdp, [variable])
    distinct, numbers = np.unique(values[:, 0], return_inverse=True)
    texts = [variable.text(value) for value in distinct.tolist()]
    if len(distinct) > MAX_NODES:
        beyond = len(distinct) - 2 * _KEPT - 1
        numbers = np.where(numbers < _KEPT, numbers, np.maximum(numbers - beyond, _KEPT))
        texts[_KEPT:-_KEPT] = [f"{texts[_KEPT]}..{texts[-_KEPT - 1]}"]
    return Nodes(values, numbers, tuple(texts))


def _values(mdp: TabularMDP, variables: Sequence[StateVariable]) -> Ints:
    return mdp.valuations[:, [mdp.variable_names.index(variable.name) for variable in variables]]
