"""Evaluate a given policy exactly, by recursion over the steps that remain."""

from __future__ import annotations

import numpy as np

from merap.errors import ModelError
from merap.mdp.model import Floats, Ints, TabularMDP
from merap.mdp.planning import choice_values, initial_value

# Single precision leaves a softmax off by some 1e-7; more is a mistake, not rounding.
_POLICY_TOLERANCE = 1e-6


def choice_weights(mdp: TabularMDP, policy: Floats) -> Floats:
    """Return the probability that a policy takes each choice in its state.

    Args:
        mdp: the model.
        policy: float [S, A], in reachable states a distribution over the enabled actions,
            up to 1e-6, which is normalised away.

    Returns:
        float64 [C], sums to 1 over a reachable state.

    Raises:
        ModelError: the policy isn't of that form; names the state.
    """
    if policy.shape != (mdp.num_states, mdp.num_actions):
        raise ModelError(f"the policy has shape {policy.shape}, not {(mdp.num_states, mdp.num_actions)}")
    weights = policy[mdp.choice_state, mdp.choice_action].astype(np.float64)
    bad = np.flatnonzero(~(weights >= 0))
    if len(bad):
        raise ModelError(f"{mdp.describe_choice(int(bad[0]))}: the policy has probability {weights[bad[0]]}")
    totals = np.bincount(mdp.choice_state, weights, minlength=mdp.num_states)
    off = np.flatnonzero(mdp.reachable & (np.abs(totals - 1) > _POLICY_TOLERANCE))
    if len(off):
        state = mdp.describe_state(int(off[0]))
        raise ModelError(f"{state}: the policy gives {totals[off[0]]} to the enabled actions, not 1")
    totals[totals == 0] = 1
    return weights / totals[mdp.choice_state]


def policy_values(mdp: TabularMDP, policy: Floats, horizon: int, discount: float = 1.0) -> Floats:
    """Return the expected return of a stochastic policy from every state and time.

    Args:
        mdp: the model.
        policy: float [S, A], or float [T, S, A], one policy per time; rows as in
            `choice_weights`.
        horizon: T, the number of steps.
        discount: in [0, 1].

    Returns:
        float64 [T + 1, S], expected return of the steps from t on (Puterman 2005, section 4.2).

    Raises:
        ModelError: the policy isn't of that form.
    """
    if policy.ndim == 3 and len(policy) != horizon:
        raise ModelError(f"the policy has {len(policy)} steps, the horizon is {horizon}")
    values = np.zeros((horizon + 1, mdp.num_states))
    weights = choice_weights(mdp, policy) if policy.ndim != 3 else None
    for t in reversed(range(horizon)):
        taken = choice_weights(mdp, policy[t]) if weights is None else weights
        of_choices = choice_values(mdp, values[t + 1], discount)
        values[t] = np.bincount(mdp.choice_state, taken * of_choices, minlength=mdp.num_states)
    return values


def expected_return(mdp: TabularMDP, policy: Floats, horizon: int, discount: float = 1.0) -> float:
    """Return the expected return of a policy from the initial distribution; see `policy_values`."""
    return initial_value(mdp, policy_values(mdp, policy, horizon, discount)[0])


def as_policy(mdp: TabularMDP, actions: Ints) -> Floats:
    """Turn deterministic actions into a policy.

    Args:
        mdp: the model.
        actions: int64 [..., S], indices of actions; -1 where there is none.

    Returns:
        float64 [..., S, A], 1 at the action and 0 elsewhere.
    """
    indicator: Floats = (actions[..., np.newaxis] == np.arange(mdp.num_actions)).astype(np.float64)
    return indicator
