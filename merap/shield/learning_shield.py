"""A shield that learns which models are still credible: what strategies and the loop are kept safe by.

Axes: T steps, S states of the canonical index (the completed state is the last), A declared actions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.belief.posterior import Belief
from merap.belief.space import HypothesisSpace
from merap.mdp.model import Bools, Floats
from merap.shield.outcomes import OutcomeSets
from merap.shield.policy import masked_policy, planning_mask
from merap.shield.shield import RobustShield, ShieldReport
from merap.shield.watch import Watch
from merap.systems.interface import Observation


@dataclass(frozen=True)
class ShieldSettings:
    """How a strategy or the loop is shielded.

    Attributes:
        threshold: lambda, on the probability of ever reaching an unsafe state in an episode.
        hazard_prior: see `hazards`.
    """

    threshold: float
    hazard_prior: float = 0.0


class LearningShield:
    """Follows the episodes with a belief of its own, and says what may be done.

    The order of calls: `begin`; whenever something arrives `shown`, `sighted`, `stepped` and, last,
    `refresh`; `allowed` before an action, and `took` when it was executed.

    Args:
        space: the hypotheses of the case.
        horizon: T, for the mask of a policy.
        settings: of the shield.

    Raises:
        InputError: nothing is declared unsafe and there is no prior on hazards, or a number is out of
            range.
    """

    def __init__(self, space: HypothesisSpace, horizon: int, settings: ShieldSettings) -> None:
        self._space = space
        self._horizon = horizon
        self._settings = settings
        self._start = np.append(space.initial, 0.0)
        self._watch = Watch(space, settings.hazard_prior)
        self._shield = RobustShield(self._outcomes, settings.threshold)

    def _outcomes(self) -> OutcomeSets:
        return self._watch.outcomes()

    @property
    def belief(self) -> Belief:
        """What it believes."""
        return self._watch.belief

    @property
    def budgets(self) -> Floats:
        """float64 [S], what is left of the episode's budget; see `RobustShield`."""
        return self._shield.budgets

    def begin(self) -> None:
        """An episode begins; the system has not been seen yet."""
        self._shield.begin()

    def shown(self, enabled: Bools) -> None:
        """What is enabled now, bool [A], whether the state is seen or not."""
        self._shield.shown(enabled)

    def sighted(self, time: int, observation: Observation) -> None:
        """Where the system was after so many steps of the episode; how it came there is not known."""
        self._watch.begin(observation)
        self._shield.seen(self._watch.state, time)
        if time == 0:
            self._start = (np.arange(len(self._start)) == self._watch.state) * 1.0

    def stepped(self, time: int, action: int, observation: Observation) -> None:
        """What the step led to with which so many steps were over, from the state seen last."""
        self._watch.observe(action, observation)
        self._shield.seen(self._watch.state, time)

    def refresh(self) -> bool:
        """Solve again if other models are credible now; whether they are."""
        return self._shield.refresh()

    def forget(self, observation: Observation | None) -> None:
        """The domain has changed: everything is credible again, but for what an observation says now.

        The budget of the episode stays spent.
        """
        self._watch = Watch(self._space, self._settings.hazard_prior)
        if observation is not None:
            self._watch.begin(observation)
        self._shield.renew()

    def allowed(self, enabled: Bools) -> Bools:
        """bool [A], never empty: of the enabled actions those that are safe wherever the system may be."""
        return self._shield.allowed(enabled)

    def took(self, action: int, *, surely: bool = True) -> None:
        """An action was executed, or may have been."""
        self._shield.took(action, surely=surely)

    @property
    def mask(self) -> Bools:
        """bool [S, A], for planners: what the whole budget of an episode could allow in one step."""
        return planning_mask(self._shield.risk, self._settings.threshold)

    def masked(self, policy: Floats) -> Floats:
        """A policy, float64 [S, A] or [T, S, A], within a mask that keeps the threshold; see `policy`.

        From where the last episode began.
        """
        shield = self._shield
        return masked_policy(
            shield.outcomes, shield.risk, policy, self._start, shield.threshold, self._horizon
        )

    @property
    def least_risk(self) -> float:
        """What any behaviour risks from where the last episode began."""
        return float(self._start @ self._shield.risk.of_states)

    def report(self) -> ShieldReport:
        """What it has done so far."""
        return self._shield.report()
