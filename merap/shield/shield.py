"""The shield: which actions may be taken now, and what has been risked.

Axes: S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.shield.budget import permitted
from merap.shield.fixpoint import robust_risk
from merap.shield.outcomes import OutcomeSets
from merap.shield.partially_observed_budget import Charge, PartiallyObservedBudget


@dataclass(frozen=True)
class ShieldReport:
    """What a shield has done.

    Attributes:
        threshold: lambda, on the probability of ever reaching an unsafe state in an episode.
        episodes: how many began.
        steps: how many actions were asked for.
        beyond_from_start: episodes that began where no behaviour can promise lambda.
        fallbacks: steps in which no action was within the budget wherever the system might be, and the
            least risky were left.
        withheld: enabled actions that were not allowed, over all steps.
        worst_risk: the largest risk Q(s, a) of an action that was taken, in any state where the system
            might be.
        changes: how often the credible models have changed.
    """

    threshold: float
    episodes: int = 0
    steps: int = 0
    beyond_from_start: int = 0
    fallbacks: int = 0
    withheld: int = 0
    worst_risk: float = 0.0
    changes: int = 0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


class RobustShield:
    """A shield with a budget over whatever models are credible; see `fixpoint`, `budget` and
    `partially_observed_budget`.

    The order of calls: `begin`, and `seen` where the system is; then `allowed` and `took` in turns, and
    `shown`, `seen` and `refresh` when anything arrives.

    Args:
        outcomes: what each action may lead to under the models credible now; the same object as
            long as they are the same.
        threshold: lambda, in [0, 1].

    Raises:
        InputError: the threshold is no probability.
    """

    def __init__(self, outcomes: Callable[[], OutcomeSets], threshold: float) -> None:
        if not 0 <= threshold <= 1:
            raise InputError(f"the threshold of a shield must be in [0, 1], it is {threshold}")
        self.threshold = threshold
        self._outcomes = outcomes
        self.outcomes = outcomes()
        self.risk = robust_risk(self.outcomes)
        self._budget = PartiallyObservedBudget(threshold, self.outcomes)
        self._counts = dict.fromkeys(
            ("episodes", "steps", "beyond_from_start", "fallbacks", "withheld", "changes"), 0
        )
        self._worst = 0.0

    @property
    def budgets(self) -> Floats:
        """float64 [S], what is left if the system is there now; infinite where it can't be."""
        return self._budget.budgets

    def begin(self) -> None:
        """An episode begins, with the whole budget; the system has not been seen yet."""
        self._budget.begin(self.outcomes)
        self._counts["episodes"] += 1

    def shown(self, enabled: Bools) -> None:
        """What is enabled now, bool [A]."""
        self._budget.show(enabled, self.outcomes)

    def seen(self, state: int, time: int | None = None) -> None:
        """Where the system was after so many actions of the episode; None: where it is."""
        self._budget.see(state, self._budget.time if time is None else time, self.risk.unsafe)

    def allowed(self, enabled: Bools) -> Bools:
        """bool [A], never empty: of the enabled actions bool [A] those that are safe enough."""
        states = self._budget.states(self.risk.unsafe)
        mask, beyond = permitted(self.risk, states, self.budgets[states], enabled)
        least = self.risk.of_states[states]
        if self._budget.time == 0 and np.any(least > self.threshold + self.risk.residual):
            self._counts["beyond_from_start"] += 1
        self._counts["steps"] += 1
        self._counts["fallbacks"] += bool(beyond)
        self._counts["withheld"] += int(np.count_nonzero(enabled & ~mask))
        return mask

    def took(self, action: int, *, surely: bool = True) -> None:
        """An action was executed, or may have been.

        It is charged what it risked when it was allowed: what the step itself teaches comes after.
        """
        states = self._budget.states(self.risk.unsafe)
        self._worst = max(self._worst, float(self.risk.of_actions[states, action].max()))
        self._budget.charge(Charge(action, surely, self.risk, self.outcomes))

    def refresh(self) -> bool:
        """Solve again if other models are credible now, whether they are; the budget stays what it is."""
        outcomes = self._outcomes()
        if outcomes is self.outcomes:
            return False
        self.outcomes = outcomes
        self.risk = robust_risk(outcomes)
        self._counts["changes"] += 1
        return True

    def renew(self) -> None:
        """The domain has changed: `refresh`, and charge what is not settled by what is credible now."""
        self.refresh()
        self._budget.renew(self.risk, self.outcomes)

    def report(self) -> ShieldReport:
        """What was done so far."""
        return ShieldReport(threshold=self.threshold, worst_risk=self._worst, **self._counts)


def shielded_policy(policy: Floats, mask: Bools) -> Floats:
    """The policy within a mask: other actions have probability 0, the rest in proportion.

    Args:
        policy: float64 [..., A].
        mask: bool [..., A].

    Returns:
        float64 [..., A]; uniform over the mask where the policy has nothing there, and the policy
        itself where the mask is empty (states nobody can act in).
    """
    kept = np.where(mask, policy, 0.0)
    kept = np.where(kept.sum(axis=-1, keepdims=True) > 0, kept, mask * 1.0)
    total = kept.sum(axis=-1, keepdims=True)
    return np.where(total > 0, kept / np.maximum(total, 1e-300), policy)
