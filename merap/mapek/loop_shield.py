"""The shield of the loop, told what the monitor knows.

Axes: T steps, S states of the canonical index (the completed state is the last), A declared actions.
"""

from __future__ import annotations

from typing import Any

from merap.belief.space import HypothesisSpace
from merap.mapek.messages import Monitored, Transition
from merap.mdp.model import Bools, Floats
from merap.shield.learning_shield import LearningShield, ShieldSettings


class LoopShield:
    """Follows what is seen, late or not at all, and says what may be done.

    Args:
        space: the hypotheses of the case.
        horizon: T.
        settings: of the shield.

    Raises:
        InputError: nothing is declared unsafe and there is no prior on hazards.
    """

    def __init__(self, space: HypothesisSpace, horizon: int, settings: ShieldSettings) -> None:
        self._shield = LearningShield(space, horizon, settings)
        self._begun = False

    def begin(self) -> None:
        """An episode begins."""
        self._begun = False
        self._shield.begin()

    def took(self, action: int, *, surely: bool) -> None:
        """An action was executed or, if the system has not answered, may have been."""
        self._shield.took(action, surely=surely)

    def observe(self, monitored: Monitored) -> None:
        """Learn from what has arrived, and solve again if other models are credible now."""
        if not monitored.problems:
            self._shield.shown(monitored.enabled)
        for news in monitored.news:
            if isinstance(news, Transition) and self._begun:
                self._shield.stepped(news.time + 1, news.action, news.observation)
            elif not news.observation.last:
                time = news.time + isinstance(news, Transition)
                self._shield.sighted(time, news.observation)
                self._begun = True
        self._shield.refresh()

    def forget(self, monitored: Monitored) -> None:
        """The domain has changed: of what is known only what has arrived now is left."""
        observation = monitored.news[-1].observation if monitored.news else None
        self._begun = observation is not None
        self._shield.forget(observation)

    def allowed(self, monitored: Monitored) -> Bools:
        """bool [A], never empty: what is enabled and safe enough wherever the system may be."""
        return self._shield.allowed(monitored.enabled)

    @property
    def mask(self) -> Bools:
        """bool [S, A], what the whole budget of an episode could allow in one step."""
        return self._shield.mask

    def masked(self, table: Floats) -> Floats:
        """A policy, float64 [S, A] or [T, S, A], within the threshold as it is carried out."""
        return self._shield.masked(table)

    def as_dict(self) -> dict[str, Any]:
        """What was done, for JSON."""
        return self._shield.report().as_dict()
