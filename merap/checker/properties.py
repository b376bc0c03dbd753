"""Define the properties that a combination is checked for, beside those of its objective."""

from __future__ import annotations

from collections.abc import Mapping

from merap.concerns.combination import Combination
from merap.mdp.reserved_names import COMPLETE_LABEL, GOAL_LABEL
from merap.program.labels import may_hold

TIMEOUT = 300.0  # seconds for a model, and for each property
REACH = "reach"
REACH_IN_TIME = "reach_within_horizon"
COMPLETE = "complete"
COMPLETE_IN_TIME = "complete_within_horizon"
REWARD = "reward"
HOLDS_IF_POSITIVE = frozenset({REACH, COMPLETE})


def properties(combination: Combination) -> Mapping[str, str]:
    """Return name -> PRISM property; the objective's own come last and replace a default of that name.

    With a goal, `reach` is the greatest probability of ever being there and
    `reach_within_horizon` the same within an episode. Without one, where the task can end,
    `complete` and `complete_within_horizon` are those of its end. `reward` is the optimum of the
    paper's `eq:policygoal`; the discount inside `C<=` is Storm's extension of the language.
    """
    objective, program = combination.objective, combination.program
    horizon = objective.horizon
    defaults = {}
    if may_hold(program, GOAL_LABEL):
        defaults[REACH] = f'Pmax=? [F "{GOAL_LABEL}"]'
        defaults[REACH_IN_TIME] = f'Pmax=? [F<={horizon} "{GOAL_LABEL}"]'
    elif may_hold(program, COMPLETE_LABEL):
        defaults[COMPLETE] = f'Pmax=? [F "{COMPLETE_LABEL}"]'
        defaults[COMPLETE_IN_TIME] = f'Pmax=? [F<={horizon} "{COMPLETE_LABEL}"]'
    discount = "" if combination.discount == 1 else f"discount={combination.discount}"
    defaults[REWARD] = f'R{{"objective"}}max=? [C<={horizon}{discount}]'
    return {**defaults, **objective.properties}
