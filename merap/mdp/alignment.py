"""Match the actions and variables of two models by name."""

from __future__ import annotations

import numpy as np

from merap.errors import ModelError
from merap.mdp.model import Ints, TabularMDP


def align_actions(mdp: TabularMDP, action_names: tuple[str, ...]) -> Ints:
    """Find each action of a model among other names.

    Args:
        mdp: the model.
        action_names: the names to find its actions in.

    Returns:
        int64 [A], an index into `action_names`; -1 for one that isn't there.
    """
    index = {name: position for position, name in enumerate(action_names)}
    return np.array([index.get(name, -1) for name in mdp.action_names], dtype=np.int64)


def align_variables(mdp: TabularMDP, variable_names: tuple[str, ...]) -> Ints:
    """Return the valuations of a model with its columns in another order.

    Args:
        mdp: the model.
        variable_names: the order that is wanted.

    Returns:
        int64 [S, len(variable_names)].

    Raises:
        ModelError: a variable exists only in one of the two; names it.
    """
    for name in mdp.variable_names:
        if name not in variable_names:
            raise ModelError(f"variable {name!r} of the model is not one of {', '.join(variable_names)}")
    for name in variable_names:
        if name not in mdp.variable_names:
            raise ModelError(f"the model has no variable {name!r}, only {', '.join(mdp.variable_names)}")
    return mdp.valuations[:, [mdp.variable_names.index(name) for name in variable_names]]
