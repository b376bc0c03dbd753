"""The budget of an episode under partial observation: steps are seen late, or never.

What `budget` says of b holds whatever decides the actions and whatever it has seen: as long as
Q(s_t, a_t) <= b_t in the state s_t where the system really is, the probability of ever reaching an
unsafe state in the episode is at most lambda. Where s_t is not seen, neither is b_t. This class keeps
B_t(s), the least that b_t can be if the system is in s now; it is infinite where the system can't be
under any credible model. When an action is executed it is charged in all those states at once,

    B_t+1(s') = rho(s') + min over the s that a_t may lead to s' from of B_t(s) - Q(s, a_t),

with rho and Q as they were when it was allowed. When it turns out that s_k was x, B_k is infinite
elsewhere, and the charges since then are made again: each is settled when its transition arrives. By
induction B_t(s_t) <= b_t, in whatever order observations arrive and if none does. An action is
allowed if Q(s, a) <= B_t(s) for all s where B_t is finite, s_t among them. So lambda holds for the
episode. A gap renews nothing: the state that is seen after it has the least that may be left there.

In each single state some action is within the budget, but there need not be one that is in all of
them. Then the one whose largest risk is the least is left, and counted as if nothing were within the
budget; what is promised is that the probability of a violation before that is at most lambda. It
does not come to that where an action that surely changes nothing is enabled, such as `stop`: for it
Q(s, a) = rho(s) <= B(s).

Also known is what is enabled, which rules out states, and that the episode goes on. Histories with a
violation do not count as long as there may have been none: for those the promise is void.

Axes: S states, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.mdp.model import Bools, Floats, Ints
from merap.shield.budget import spent
from merap.shield.fixpoint import Risk
from merap.shield.outcomes import OutcomeSets


@dataclass(frozen=True, eq=False)
class Charge:
    """An action that was executed.

    Attributes:
        action: its number.
        surely: whether it is known that it was; else it may have been.
        risk: as it was when the action was allowed.
        sets: likewise.
        enabled: bool [A], what was enabled after it; None: not known.
    """

    action: int
    surely: bool
    risk: Risk
    sets: OutcomeSets
    enabled: Bools | None = None


class PartiallyObservedBudget:
    """What is left of an episode's budget, wherever the system may be.

    Args:
        threshold: lambda.
        sets: what is credible before anything is seen.
    """

    def __init__(self, threshold: float, sets: OutcomeSets) -> None:
        self._threshold = threshold
        self._num_states = sets.num_states
        self.begin(sets)

    def begin(self, sets: OutcomeSets) -> None:
        """An episode begins with the whole budget; until it is seen, the system may be anywhere."""
        self._begun = 0
        self._budgets = [np.where(sets.acting, self._threshold, np.inf)]
        self._charges: list[Charge] = []

    @property
    def budgets(self) -> Floats:
        """float64 [S], B: the least that may be left; infinite where the system can't be."""
        return self._budgets[-1]

    @property
    def time(self) -> int:
        """How many actions were executed in the episode."""
        return self._begun + len(self._charges)

    def states(self, unsafe: Bools) -> Ints:
        """int64 [X], where the system may be; the unsafe ones, bool [S], only if it must be in one."""
        return np.flatnonzero(_possible(self.budgets, unsafe))

    def charge(self, charge: Charge) -> None:
        """An action was executed."""
        self._charges.append(charge)
        self._budgets.append(self._after(self.budgets, charge))

    def show(self, enabled: Bools, sets: OutcomeSets) -> None:
        """What is enabled now, bool [A]."""
        self._budgets[-1] = _kept(self.budgets, consistent(sets, enabled))
        if self._charges:
            self._charges[-1] = replace(self._charges[-1], enabled=enabled)

    def see(self, state: int, time: int, unsafe: Bools) -> None:
        """Where the system was after so many actions; of before what is known already, nothing is new.

        A state that no credible model explains has the least that may be left anywhere.
        """
        number = time - self._begun
        if number < 0:
            return
        before = self._budgets[number]
        left = before[state] if np.isfinite(before[state]) else before[_possible(before, unsafe)].min()
        known = np.full(self._num_states, np.inf)
        known[state] = left
        self._begun, charges = time, self._charges[number:]
        self._replay(known, charges)

    def renew(self, risk: Risk, sets: OutcomeSets) -> None:
        """Other models are credible than was thought: whatever is not settled is charged by them."""
        self._replay(self._budgets[0], [replace(one, risk=risk, sets=sets) for one in self._charges])

    def _replay(self, budgets: Floats, charges: list[Charge]) -> None:
        self._budgets, self._charges = [budgets], charges
        for charge in charges:
            self._budgets.append(self._after(self.budgets, charge))

    def _after(self, budgets: Floats, charge: Charge) -> Floats:
        """float64 [S]."""
        sets, here = charge.sets, _possible(budgets, charge.risk.unsafe)
        origin, action = np.divmod(sets.rows.choice, sets.num_actions)
        row = np.flatnonzero(here[origin] & (action == charge.action))
        slot = sets.rows.prob[row] > 0
        target = sets.rows.target[row][slot]
        state = np.repeat(origin[row], slot.sum(axis=1))
        found = np.full(self._num_states, np.inf)
        left = spent(charge.risk, self._threshold, state, charge.action, target, budgets[state])
        np.minimum.at(found, target, left)
        stays = here.copy()
        if charge.surely:
            # An action that no credible model has there is taken to have done nothing.
            stays[state] = False
        found = np.minimum(found, np.where(stays, budgets, np.inf))
        found = _kept(found, sets.acting)
        return found if charge.enabled is None else _kept(found, consistent(sets, charge.enabled))


def consistent(sets: OutcomeSets, enabled: Bools) -> Bools:
    """bool [S]: some credible model may have exactly these actions, bool [A], enabled there."""
    possible = sets.table(np.ones(len(sets.choice), dtype=np.bool_), False)
    sure = sets.table(sets.sure, False)
    return np.asarray(np.all((possible | ~enabled) & (enabled | ~sure), axis=1))


def _possible(budgets: Floats, unsafe: Bools) -> Bools:
    """bool [S]: where the system may be without a violation, or at all if there must have been one."""
    return np.isfinite(_kept(budgets, ~unsafe))


def _kept(budgets: Floats, where: Bools) -> Floats:
    """The budgets in some of the states; all of them if none is possible."""
    kept: Floats = np.where(where, budgets, np.inf)
    return kept if np.isfinite(kept).any() else budgets
