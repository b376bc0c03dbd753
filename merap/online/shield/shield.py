"""The shield: which actions may be taken now, and what has been risked.

Axes: S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.online.shield.budget import permitted, spent
from merap.online.shield.fixpoint import Risk, robust_risk
from merap.online.shield.outcomes import OutcomeSets


@dataclass(frozen=True)
class ShieldReport:
    """What a shield has done.

    Attributes:
        threshold: lambda, on the probability of ever reaching an unsafe state in an episode.
        episodes: how many began.
        steps: how many actions were asked for.
        beyond_from_start: episodes that began where no behaviour can promise lambda.
        fallbacks: steps in which no action was within the budget, and the least risky were left.
        withheld: enabled actions that were not allowed, over all steps.
        worst_risk: the largest risk Q(s, a) of an action that was taken.
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


class Shield(Protocol):
    """Says what may be done. The order of calls: `begin`, then `allowed` and `took` in turns."""

    def begin(self, state: int) -> None:
        """An episode begins."""

    def allowed(self, state: int, enabled: Bools) -> Bools:
        """bool [A], never empty, of the enabled actions bool [A]."""

    def took(self, action: int, state: int) -> None:
        """An action was taken and led to a state."""

    def refresh(self) -> None:
        """What is credible may have changed."""

    def report(self) -> ShieldReport:
        """What was done so far."""


class RobustShield:
    """A shield with a budget over whatever models are credible; see `fixpoint` and `budget`.

    Args:
        outcomes: what each action may lead to under the models credible now; the same object as
            long as they are the same.
        threshold: lambda, in [0, 1].
        horizon: T: only the steps of an episode count; None: of ever.

    Raises:
        InputError: the threshold is no probability.
    """

    def __init__(
        self, outcomes: Callable[[], OutcomeSets], threshold: float, horizon: int | None = None
    ) -> None:
        if not 0 <= threshold <= 1:
            raise InputError(f"the threshold of a shield must be in [0, 1], it is {threshold}")
        self.threshold = threshold
        self.horizon = horizon
        self._outcomes = outcomes
        self.outcomes = outcomes()
        self.risk = robust_risk(self.outcomes, horizon)
        self._counts = dict.fromkeys(
            ("episodes", "steps", "beyond_from_start", "fallbacks", "withheld", "changes"), 0
        )
        self._worst = 0.0
        self._state, self._time = -1, 0
        self._decided = self.risk_now
        self.budget = threshold

    @property
    def risk_now(self) -> Risk:
        """The risk of the steps that remain."""
        return self.risk.at(self._time)

    def begin(self, state: int) -> None:
        """An episode begins, with the whole budget."""
        self._state, self._time, self.budget = state, 0, self.threshold
        self._counts["episodes"] += 1
        least = self.risk.of_states if self.risk.of_states.ndim == 1 else self.risk.of_states[0]
        self._decided = self.risk_now
        self._counts["beyond_from_start"] += bool(least[state] > self.threshold + self.risk.residual)

    def allowed(self, state: int, enabled: Bools) -> Bools:
        """bool [A], never empty."""
        self._decided = self.risk_now
        mask, beyond = permitted(self._decided, state, self.budget, enabled)
        self._counts["steps"] += 1
        self._counts["fallbacks"] += bool(beyond)
        self._counts["withheld"] += int(np.count_nonzero(enabled & ~mask))
        return mask

    def took(self, action: int, state: int) -> None:
        """An action was taken and led to a state.

        It is charged what it risked when it was allowed: what the step itself has taught comes after.
        """
        now = self._decided
        self._worst = max(self._worst, float(now.of_actions[self._state, action]))
        self.budget = float(spent(now, self.threshold, self._state, action, state, self.budget))
        self._state = state
        self._time += 1

    def refresh(self) -> None:
        """Solve again if other models are credible now; the budget stays what it is."""
        outcomes = self._outcomes()
        if outcomes is not self.outcomes:
            self.outcomes = outcomes
            self.risk = robust_risk(outcomes, self.horizon)
            self._counts["changes"] += 1

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
