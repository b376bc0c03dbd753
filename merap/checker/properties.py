"""The properties every combination is checked for, beside those of its objective."""

from __future__ import annotations

from collections.abc import Mapping

from merap.concerns.combination import Combination
from merap.mdp.reserved_names import GOAL_LABEL

REACH = "reach"
REACH_IN_TIME = "reach_within_horizon"
REWARD = "reward"


def properties(combination: Combination) -> Mapping[str, str]:
    """Name -> PRISM property; the objective's own come last and replace a default of that name.

    `reach`: greatest probability of ever being in the goal. `reach_within_horizon`: the same
    within an episode. `reward`: the optimum of the paper's `eq:policygoal`; the discount inside
    `C<=` is Storm's extension of the language.
    """
    horizon = combination.objective.horizon
    defaults = {
        REACH: f'Pmax=? [F "{GOAL_LABEL}"]',
        REACH_IN_TIME: f'Pmax=? [F<={horizon} "{GOAL_LABEL}"]',
        REWARD: f'R{{"objective"}}max=? [C<={horizon}discount={combination.discount}]',
    }
    if combination.discount == 1:
        defaults[REWARD] = f'R{{"objective"}}max=? [C<={horizon}]'
    return {**defaults, **combination.objective.properties}
