"""A budget of risk: what makes a threshold on single steps hold for a whole episode.

To allow every action with Q(s, a) <= lambda does not keep the probability of ever reaching an
unsafe state below lambda: the risk may be taken again in each step. So an episode carries a budget
b, at first lambda. An action is allowed if Q(s, a) <= b, and then, with s' the successor,

    b' = rho(s') + (b - Q(s, a)).

Under every credible model p, E[b'] = sum of p(s') rho(s') + b - Q(s, a) <= b, as Q is the maximum
over the models: b is a supermartingale. It is never negative, and at least 1 in an unsafe state, so
by optional stopping the probability of ever reaching one is at most the first b (Ville's inequality
for the nonnegative supermartingale b). No action is wanting while b >= rho(s), which each step
preserves. If b begins below rho(s), no behaviour can promise lambda; then, and when the credible
models have changed for the worse, only the least risky actions are left. They are reported. What is
done where the system is not seen is in `partially_observed_budget`.

After a violation the promise is void, and the budget lambda anew: the way back is as careful.

All functions work on any number of episodes side by side (axis B, or none); X states where the system
may be, in each of them.
"""

from __future__ import annotations

import numpy as np

from merap.mdp.model import Bools, Floats, Ints
from merap.shield.fixpoint import Risk


def permitted(risk: Risk, state: Ints, budget: Floats, enabled: Bools) -> tuple[Bools, Bools]:
    """What may be done.

    Args:
        risk: of every step, [S, A].
        state: int64 [B, X], the states where the system may be.
        budget: float64 [B, X], what is left if it is there.
        enabled: bool [B, A], not empty.

    Returns:
        bool [B, A], never empty: the enabled actions that are within the budget in all the states or,
        if there are none, those whose largest risk is the least; and bool [B], whether there were none.
    """
    q, certain = risk.of_actions[state], risk.certain[state]
    left = budget[..., np.newaxis]
    within = enabled & np.all(certain | ((left > 0) & (q <= left + risk.residual)), axis=-2)
    none = np.asarray(~within.any(axis=-1))
    worst = q.max(axis=-2)
    least = np.where(enabled, worst, np.inf).min(axis=-1, keepdims=True)
    least_risky = enabled & (worst <= least + risk.residual)
    return np.where(none[..., np.newaxis], least_risky, within), none


def spent(
    risk: Risk,
    threshold: float,
    state: Ints | int,
    action: Ints | int,
    successor: Ints | int,
    budget: Floats | float,
) -> Floats:
    """The budget after a step.

    Args:
        risk: as for `permitted`, before the step.
        threshold: lambda.
        state: int64 [B].
        action: int64 [B].
        successor: int64 [B].
        budget: float64 [B], before the step.
    """
    left = risk.of_states[successor] + np.maximum(budget - risk.of_actions[state, action], 0.0)
    return np.where(risk.unsafe[successor], threshold, left)
