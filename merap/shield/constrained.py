"""What is possible within a shield's threshold if the true model is known: what a shielded loop is held to.

The best expected return of all policies, with or without chance, whose probability of reaching an
unsafe state within the horizon is at most lambda, or the least there is. It is a constrained MDP
(Altman 1999). What the constraint is worth comes from its dual,

    min over m >= 0 of max over policies of E[return] - m (P[violation] - lambda),

a convex, piecewise linear function of the price m of a violation. Each price is a backward
induction. Two of its lines enclose the minimum, and the price at which they meet gives the next one.

At a threshold of 0 a shield leaves only actions after which no violation ever need happen, also
after the horizon; so the policies are those within that mask.

Axes: S states, C choices, T steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.mdp.csr import first_match, row_best
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.mdp.planning import backward_induction, choice_values, initial_value
from merap.mdp.reachability import bounded_reachability
from merap.shield.fixpoint import robust_risk
from merap.shield.models import model_sets
from merap.shield.policy import slack_mask

# A price of a violation, in ranges of returns, that no policy pays if it need not.
DEAR = 1e9
# Prices are refined until a policy is not better than the lines by more than that part of the range.
PRECISION = 1e-10


@dataclass(frozen=True)
class _Line:
    """A best policy for a price: what it returns, and how probably it violates."""

    value: float
    risk: float

    def at(self, price: float, threshold: float) -> float:
        """Its value less what it pays for its excess."""
        return self.value - price * (self.risk - threshold)


def constrained_optimum(model: TabularMDP, unsafe: Bools, threshold: float, horizon: int) -> float:
    """The best expected undiscounted return within the threshold.

    Args:
        model: the true one, with its completed state.
        unsafe: bool [S].
        threshold: lambda, in [0, 1].
        horizon: T.
    """
    after = backward_induction(model, horizon).values
    if threshold == 0:
        return _line(model, unsafe, after, DEAR * _span(after), _permitted(model, unsafe)).value
    least = initial_value(model, bounded_reachability(model, unsafe, horizon, maximise=False))
    everything = np.ones(model.num_choices, dtype=np.bool_)

    def best(price: float) -> _Line:
        return _line(model, unsafe, after, price, everything)

    bound, high = max(threshold, least), best(0.0)
    if high.risk <= bound:
        return high.value
    price, low = DEAR * _span(after), best(DEAR * _span(after))
    while high.risk > low.risk:
        price = (high.value - low.value) / (high.risk - low.risk)
        found, attained = best(price), high.at(price, bound)
        if found.at(price, bound) <= attained + PRECISION * _span(after):
            return attained
        high, low = (found, low) if found.risk > bound else (high, found)
    return low.value


def _span(values: Floats) -> float:
    return 1.0 + float(np.ptp(values))


def _permitted(model: TabularMDP, unsafe: Bools) -> Bools:
    """bool [C]: what a shield at 0 leaves, and whatever there is in completed states."""
    sets = model_sets([model], unsafe).outcomes(np.ones(1, dtype=np.bool_))
    mask = slack_mask(robust_risk(sets), 0.0)
    wide = np.pad(mask, ((0, 0), (0, model.num_actions - mask.shape[1])), constant_values=True)
    allowed: Bools = wide[model.choice_state, model.choice_action]
    return allowed


def _line(model: TabularMDP, unsafe: Bools, after: Floats, price: float, allowed: Bools) -> _Line:
    """The best policy among choices bool [C] for a price of the first violation.

    Args:
        model: the true one.
        unsafe: bool [S].
        after: float64 [T + 1, S], what can be had with so many steps behind, whatever has happened:
            once a violation has happened it can't be avoided any more.
        price: of a violation.
        allowed: bool [C], before a violation.
    """
    paid, value, risk = unsafe * price, after[-1].copy(), np.where(unsafe, 1.0, 0.0)
    priced = value - paid
    for later in after[-2::-1]:
        of_choices = np.where(allowed, choice_values(model, priced), -np.inf)
        best = row_best(of_choices, model.state_to_choice, maximise=True)
        chosen = first_match(of_choices, best, model.choice_state)
        acting = chosen >= 0
        onward = choice_values(model, value)[chosen]
        falls = (model.transitions @ risk)[chosen]
        value = np.where(unsafe, later, np.where(acting, onward, 0.0))
        risk = np.where(unsafe, 1.0, np.where(acting, falls, 0.0))
        priced = np.where(unsafe, later - paid, best)
    return _Line(initial_value(model, value), initial_value(model, risk))
