"""A shield that learns which models are still credible; it keeps strategies and the loop safe.

Axes: T steps, S states of the index, A declared actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from merap.belief.posterior import Belief
from merap.belief.space import HypothesisSpace
from merap.concerns.arguments import as_number
from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.shield.credible_tracker import CredibleTracker
from merap.shield.outcomes import OutcomeSets
from merap.shield.policy import masked_policy, planning_mask
from merap.shield.shield import RobustShield, ShieldReport
from merap.systems.interface import Observation
from merap.systems.sightings import News, Transition


@dataclass(frozen=True)
class ShieldSettings:
    """How a strategy or the loop is shielded.

    Attributes:
        threshold: lambda, on the probability of ever reaching an unsafe state in an episode.
        hazard_prior: see `hazards`.

    Raises:
        InputError: the threshold is no probability, or the prior no number.
    """

    threshold: float
    hazard_prior: float = 0.0

    def __post_init__(self) -> None:
        threshold, prior = as_number(self.threshold, "shield"), as_number(self.hazard_prior, "hazard_prior")
        if not 0 <= threshold <= 1:
            raise InputError(f"the threshold of a shield must be in [0, 1], it is {self.threshold}")
        object.__setattr__(self, "threshold", threshold)
        object.__setattr__(self, "hazard_prior", prior)


class LearningShield:
    """Follows the episodes with a belief of its own, and says which actions are safe enough.

    The order of calls: `begin`; `follow` whenever something arrives, or `sighted`, `stepped` and, last,
    `refresh` instead; `allowed` before an action, and `took` when it was executed.

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
        self._tracker = CredibleTracker(space, settings.hazard_prior)
        self._shield = RobustShield(self._outcomes, settings.threshold)
        self._located = False

    def _outcomes(self) -> OutcomeSets:
        return self._tracker.outcomes()

    @property
    def belief(self) -> Belief:
        """The belief of the shield."""
        return self._tracker.belief

    @property
    def budgets(self) -> Floats:
        """float64 [S], what is left of the episode's budget; see `RobustShield`."""
        return self._shield.budgets

    def begin(self) -> None:
        """Begin an episode; the system has not been seen yet."""
        self._located = False
        self._shield.begin()

    def follow(self, news: Sequence[News], enabled: Bools | None) -> None:
        """Learn from what has arrived, and solve again if other models are credible now.

        Args:
            news: in the order of arrival; a transition counts as such once the shield knows where it began.
            enabled: bool [A], the actions that are possible now; None: not known.
        """
        if enabled is not None:
            self._shield.shown(enabled)
        for one in news:
            if isinstance(one, Transition) and self._located:
                self.stepped(one.time + 1, one.action, one.observation)
            elif not one.observation.last:
                self.sighted(one.time + isinstance(one, Transition), one.observation)
        self.refresh()

    def sighted(self, time: int, observation: Observation) -> None:
        """Take in where the system was after `time` steps of the episode; how it came there is not known."""
        self._located = True
        self._tracker.begin(observation)
        self._shield.seen(self._tracker.state, time)
        if time == 0:
            self._start = (np.arange(len(self._start)) == self._tracker.state) * 1.0

    def stepped(self, time: int, action: int, observation: Observation) -> None:
        """Take in where the step led that was number `time` of the episode, from the state seen last."""
        self._tracker.observe(action, observation)
        self._shield.seen(self._tracker.state, time)

    def refresh(self) -> bool:
        """Solve again if other models are credible now; return whether they are."""
        return self._shield.refresh()

    def forget(self, observation: Observation | None) -> None:
        """Hold everything credible again but what one observation rules out, since the domain has changed.

        The budget of the episode stays spent.
        """
        self._located = observation is not None
        self._tracker = CredibleTracker(self._space, self._settings.hazard_prior)
        if observation is not None:
            self._tracker.begin(observation)
        self._shield.renew()

    def allowed(self, enabled: Bools) -> Bools:
        """Return bool [A], never empty: the enabled actions that are safe wherever the system may be."""
        return self._shield.allowed(enabled)

    def took(self, action: int, *, surely: bool = True) -> None:
        """Charge an action that was executed, or may have been."""
        self._shield.took(action, surely=surely)

    @property
    def mask(self) -> Bools:
        """bool [S, A], for planners: the actions that the whole budget of an episode could allow."""
        own = planning_mask(self._shield.risk, self._settings.threshold)
        mask: Bools = self._space.outward(own, True)
        return mask

    def masked(self, policy: Floats) -> Floats:
        """Return a policy, float64 [S, A] or [T, S, A], within a mask that keeps the threshold.

        It does so for an episode that begins where the last one began; see `policy`.
        """
        shield, uniform = self._shield, 1 / policy.shape[-1]
        own = masked_policy(
            shield.outcomes,
            shield.risk,
            self._space.inward(policy, uniform),
            self._start,
            shield.threshold,
            self._horizon,
        )
        masked: Floats = self._space.outward(own, uniform)
        return masked

    @property
    def least_risk(self) -> float:
        """The least risk of any behaviour from where the last episode began."""
        return float(self._start @ self._shield.risk.of_states)

    def report(self) -> ShieldReport:
        """Return what it has done so far."""
        return self._shield.report()


class Unshielded:
    """Stands for the shield of a loop that has none: every enabled action is safe enough."""

    mask = None

    def begin(self) -> None:
        """Begin an episode."""

    def follow(self, news: Sequence[News], enabled: Bools | None) -> None:
        """Learn nothing."""

    def forget(self, observation: Observation | None) -> None:
        """Forget nothing."""

    def allowed(self, enabled: Bools) -> Bools:
        """Return the enabled actions, bool [A]."""
        return enabled

    def took(self, action: int, *, surely: bool = True) -> None:
        """Charge nothing."""

    def masked(self, policy: Floats) -> Floats:
        """Return the policy."""
        return policy

    def report(self) -> ShieldReport | None:
        """Return nothing: no shield has done anything."""
        return None


Shield: TypeAlias = LearningShield | Unshielded
