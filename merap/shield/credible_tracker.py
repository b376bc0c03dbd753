"""What a shield knows of the system that is met: a belief of its own, hazards, what is credible.

The belief is the shield's, whatever the strategy is: also a strategy without a belief is shielded
by what its episodes have shown.
"""

from __future__ import annotations

from collections.abc import Mapping

from merap.belief.posterior import Belief, prior_belief
from merap.belief.space import HypothesisSpace
from merap.belief.update import ObservedStep, observe_state, observe_step
from merap.errors import InputError
from merap.shield.credible import credible, credible_outcomes, unsafe_states
from merap.shield.hazards import Hazards
from merap.shield.outcomes import OutcomeSets
from merap.systems.interface import Observation
from merap.systems.strategy import StateIndex

# A true hypothesis is ever dropped with at most this probability.
DOUBT = 1e-4


class CredibleSource:
    """Outcome sets of a belief, made again only if other hypotheses are credible than before.

    Args:
        space: the hypotheses of the case.
        hazard_prior: probability of each location but the start to be unsafe in a way no
            configuration says; see `hazards`.
        doubt: see `models.credible_models`.

    Raises:
        InputError: nothing is declared unsafe and there is no prior on hazards, or a number is out of
            range.
    """

    def __init__(self, space: HypothesisSpace, hazard_prior: float = 0.0, doubt: float = DOUBT) -> None:
        if not 0 <= doubt < 1:
            raise InputError(f"the doubt of a shield must be in [0, 1), it is {doubt}")
        self._space = space
        self._doubt = doubt
        self._unsafe = unsafe_states(space, required=hazard_prior == 0)
        self._hazards = Hazards(space.case.combine(0, 0, 0), hazard_prior)
        self._signature = b""
        self._outcomes: OutcomeSets | None = None

    def visit(self, state: int, detections: Mapping[str, object]) -> None:
        """The system is in a state, and its detectors read something: what that tells of hazards."""
        if state < self._space.num_states:
            self._hazards.visit(state // self._space.num_modes, detections)

    def outcomes(self, belief: Belief) -> OutcomeSets:
        """What each action may lead to; the same object while the same is credible."""
        left = credible(self._space, belief, self._doubt)
        signature = left.signature(belief) + self._hazards.prob.tobytes()
        if self._outcomes is None or signature != self._signature:
            hazards = self._hazards.prob.copy()
            self._outcomes = credible_outcomes(self._space, belief, left, self._unsafe, hazards)
            self._signature = signature
        return self._outcomes


class CredibleTracker:
    """Follows the episodes and gives the outcome sets of what is credible now.

    Args:
        space: the hypotheses of the case.
        hazard_prior: see `CredibleSource`.
        doubt: see `CredibleSource`.

    Raises:
        InputError: see `CredibleSource`.
    """

    def __init__(self, space: HypothesisSpace, hazard_prior: float = 0.0, doubt: float = DOUBT) -> None:
        self._space = space
        self._source = CredibleSource(space, hazard_prior, doubt)
        self._index = StateIndex(space.states)
        self.belief: Belief = prior_belief(space)
        self.state = -1

    def begin(self, observation: Observation) -> None:
        """An episode begins."""
        self.state = self._index(observation)
        self._look(observation)

    def observe(self, action: int, observation: Observation) -> None:
        """What a step has led to."""
        target = self._index(observation)
        step = ObservedStep(self.state, action, target, observation.reward)
        self.belief = observe_step(self._space, self.belief, step)
        self.state = target
        self._look(observation)

    def _look(self, observation: Observation) -> None:
        if self.state < self._space.num_states:
            self._source.visit(self.state, observation.detections)
        self.belief = observe_state(self._space, self.belief, self.state, observation)

    def outcomes(self) -> OutcomeSets:
        """What each action may lead to; the same object while the same is credible."""
        return self._source.outcomes(self.belief)
