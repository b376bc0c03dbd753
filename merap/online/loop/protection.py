"""What keeps the loop from unsafe states: a shield over the models that are still credible.

Axes: T steps, S states of the canonical index (the completed state is the last), A declared actions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from merap.mdp.model import Bools, Floats
from merap.online.belief.space import HypothesisSpace
from merap.online.loop.messages import Analysis, Monitored, Transition
from merap.online.shield.policy import masked_policy, slack_mask
from merap.online.shield.shield import RobustShield, ShieldReport
from merap.online.shield.shielded_strategy import ShieldSettings
from merap.online.shield.watch import Watch

# Where the system is not seen, an action must be allowed in every state as probable as this.
PROBABLE = 0.01


class Protection:
    """Follows what is seen with a belief of its own, and says what may be done.

    After a gap in what is seen the shield begins anew, with the whole budget of an episode.

    Args:
        space: the hypotheses of the case.
        horizon: T.
        settings: of the shield.

    Raises:
        InputError: nothing is declared unsafe and there is no prior on hazards.
    """

    def __init__(self, space: HypothesisSpace, horizon: int, settings: ShieldSettings) -> None:
        self._space = space
        self._horizon = horizon
        self._settings = settings
        self._past: list[ShieldReport] = []
        self._renew()

    def _renew(self) -> None:
        self._watch = Watch(self._space, self._settings.hazard_prior)
        self._shield = RobustShield(self._watch.outcomes, self._settings.threshold)
        self._begun = False

    def forget(self) -> None:
        """The domain has changed: everything is credible again, as at first."""
        self._past.append(self._shield.report())
        self._renew()

    def begin(self) -> None:
        """An episode begins."""
        self._begun = False

    def observe(self, monitored: Monitored) -> None:
        """Learn from what has arrived, and solve again if other models are credible now."""
        for news in monitored.news:
            if isinstance(news, Transition) and self._begun:
                self._watch.observe(news.action, news.observation)
                self._shield.took(news.action, self._watch.state)
            elif not news.observation.last:
                self._watch.begin(news.observation)
                self._shield.begin(self._watch.state)
                self._begun = True
        self._shield.refresh()

    def allowed(self, monitored: Monitored, analysis: Analysis) -> Bools:
        """bool [A], never empty: what is enabled and safe enough in all states where the system may be."""
        mask = monitored.enabled
        for state in np.flatnonzero(analysis.whereabouts[:-1] >= PROBABLE):
            both = mask & self._shield.allowed(int(state), monitored.enabled)
            mask = both if both.any() else mask
        return mask

    @property
    def mask(self) -> Bools:
        """bool [S, A], what the whole budget of an episode could allow in one step."""
        risk = self._shield.risk
        within: Bools = risk.of_actions <= self._settings.threshold
        return within | slack_mask(risk, 0.0)

    def masked(self, table: Floats) -> Floats:
        """A policy, float64 [S, A] or [T, S, A], within the threshold as it is carried out."""
        start = np.append(self._space.initial, 0.0)
        return masked_policy(
            self._shield.outcomes, self._shield.risk, table, start, self._settings.threshold, self._horizon
        )

    def as_dict(self) -> dict[str, Any]:
        """What was done, over all adaptations, for JSON."""
        found = [*self._past, self._shield.report()]
        counted = ("episodes", "steps", "beyond_from_start", "fallbacks", "withheld", "changes")
        return {
            "threshold": self._settings.threshold,
            **{name: sum(getattr(one, name) for one in found) for name in counted},
            "worst_risk": max(one.worst_risk for one in found),
        }
