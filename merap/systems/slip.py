"""Add slip to a model: with some probability an action does nothing, in any state.

The state stays, the step counts and its reward is that of the step (s, a, s); a task that ends after the
action (`ends_after`) ends all the same. `belief.space` holds the same hypothesis.
"""

from __future__ import annotations

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.synthesis import attach, synthesise_pair
from merap.errors import InputError
from merap.families.build import canonical
from merap.mdp.assembly import Branches, assemble
from merap.mdp.model import TabularMDP


def slipping_model(combination: DeclaredCombination, slip: float) -> TabularMDP:
    """Build the canonical model of a combination that slips, by its definition.

    Raises:
        InputError: the probability is not in [0, 1), or a reachable state has no action.
    """
    return canonical(combination, attach(slipping_pair(combination, slip), combination))


def slipping_pair(combination: DeclaredCombination, slip: float) -> TabularMDP:
    """Build environment and capability of a combination, see `synthesise_pair`, with slip.

    Raises:
        InputError: the probability is not in [0, 1).
    """
    if not 0 <= slip < 1:
        raise InputError(f"the probability to slip must be in [0, 1), it is {slip}")
    pair = synthesise_pair(combination)
    if slip == 0:
        return pair
    nothing = np.zeros(pair.num_branches + pair.num_choices)
    return assemble(
        Branches(
            state=np.concatenate([pair.choice_state[pair.branch_choice], pair.choice_state]),
            action=np.concatenate([pair.choice_action[pair.branch_choice], pair.choice_action]),
            target=np.concatenate([pair.branch_target, pair.choice_state]),
            prob=np.concatenate([pair.branch_prob * (1 - slip), np.full(pair.num_choices, slip)]),
            reward=nothing,
        ),
        initial=pair.initial,
        labels={},
        valuations=pair.valuations,
        variable_names=pair.variable_names,
        action_names=pair.action_names,
    )
