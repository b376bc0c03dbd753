"""A mask for a policy that has no memory: within the threshold under every credible model.

The budget of an episode (`budget`) depends on its history, which a table of probabilities can't. So a
table is masked by how much an action risks more than the least risky one: allowed is a if
Q(s, a) <= rho(s) + d. For any such policy rho(s_t) + (T - t) d is a supermartingale, so its risk over
T steps is at most rho(s_0) + T d. The largest d is sought for which the risk of this very policy,
exactly and under the worst of the models, is within the threshold; d = (lambda - rho(s_0)) / T
always is. With lambda = 0 the mask is the one an episode has too.

Axes as in `fixpoint`; T steps.
"""

from __future__ import annotations

import numpy as np

from merap.mdp.model import Bools, Floats
from merap.shield.fixpoint import Risk, choice_risk
from merap.shield.outcomes import OutcomeSets
from merap.shield.shield import shielded_policy

HALVINGS = 6


def slack_mask(risk: Risk, slack: float) -> Bools:
    """bool [S, A]: actions that risk at most `slack` more than the least risky one.

    Where no credible model has an action the row is empty.
    """
    bound = risk.of_states[:, np.newaxis] + slack
    return risk.certain | ((bound > 0) & (risk.of_actions <= bound + risk.residual))


def planning_mask(risk: Risk, threshold: float) -> Bools:
    """bool [S, A]: what the whole budget of an episode could allow in one step, or is least risky."""
    within: Bools = risk.of_actions <= threshold
    return within | slack_mask(risk, 0.0)


def policy_risk(sets: OutcomeSets, policy: Floats, horizon: int) -> Floats:
    """The greatest probability of a violation within T steps under any credible model.

    Where the policy relies on an action that some credible model disables, the worst action that it
    takes there counts.

    Args:
        sets: what each action may lead to.
        policy: float64 [S, A] or [T, S, A]; in proportion where only some actions are possible.
        horizon: T.

    Returns:
        float64 [S].
    """
    values = sets.unsafe.astype(np.float64)
    possible = sets.table(np.ones(len(sets.choice), dtype=np.bool_), False)
    sure = sets.table(sets.sure, False)
    for t in reversed(range(horizon)):
        shares = (policy[t] if policy.ndim == 3 else policy) * possible
        shares = np.where(shares.sum(axis=1, keepdims=True) > 0, shares, possible * 1.0)
        of_actions = sets.table(choice_risk(sets, values), 0.0)
        mean = (shares * of_actions).sum(axis=1) / np.maximum(shares.sum(axis=1), 1e-300)
        worst = np.where(shares > 0, of_actions, 0.0).max(axis=1)
        unsure = ((shares > 0) & ~sure).any(axis=1)
        values = np.where(sets.unsafe, 1.0, np.where(unsure, worst, mean))
    return values


def masked_policy(
    sets: OutcomeSets, risk: Risk, policy: Floats, start: Floats, threshold: float, horizon: int
) -> Floats:
    """The policy within the widest mask that keeps it within the threshold.

    Args:
        sets: what each action may lead to.
        risk: of the sets.
        policy: float64 [S, A] or [T, S, A].
        start: float64 [S], a distribution.
        threshold: lambda.
        horizon: T.

    Returns:
        float64, like the policy. Where no behaviour can promise lambda, the least risky one.
    """
    least = float(start @ risk.of_states)
    promised = max(threshold, least)
    allotted = max(threshold - least, 0.0) / horizon
    if threshold == 0:
        return shielded_policy(policy, slack_mask(risk, 0.0))
    for slack in (1.0, *(promised * 0.5**n for n in range(HALVINGS))):
        if slack <= allotted:
            break
        masked = shielded_policy(policy, slack_mask(risk, slack))
        if float(start @ policy_risk(sets, masked, horizon)) <= promised + horizon * risk.residual:
            return masked
    return shielded_policy(policy, slack_mask(risk, allotted))
