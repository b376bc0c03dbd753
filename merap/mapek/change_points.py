"""Change points amid an adaptation: beliefs that ignore the episodes before one.

A belief that has seen both sides of a change explains the change away: a hypothesis that was refuted before
it stays refuted, and a false compromise is left. So at the beginning of each episode another belief begins
from the prior, and the observations from there on are held against both:

    O_k = p(observations since episode k | the prior) / p(the same | the observations before it)

Without a change, for a system drawn from the prior, each O_k is a martingale with a mean of 1: it ever
exceeds c with a probability of at most 1 / c (Ville). O_k is the Bayes factor of a change point at k (Adams
and MacKay 2007, "Bayesian online changepoint detection"). Each of the last few episodes is tried as a change
point.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from merap.belief.posterior import Belief, prior_belief
from merap.belief.space import HypothesisSpace

# Number of recent episodes that are tried as change points.
CHANGE_POINTS = 3
# Log-odds from which on a change is believed: with e^12 one adaptation in some 10,000, of ten episodes and
# more, begins anew for nothing.
CONVINCED = 12.0
# Nats of an observation that no hypothesis allows.
UNEXPLAINED = -12.0


@dataclass(frozen=True, eq=False)
class ChangePoint:
    """A belief that began with an episode.

    Attributes:
        episode: the first that it has seen.
        belief: its posterior.
        before: evidence of the belief over all episodes when it began.
    """

    episode: int
    belief: Belief
    before: float

    def log_odds(self, whole: Belief) -> float:
        """Return the log of O_k, given the belief over all episodes."""
        return _evidence(self.belief) - (_evidence(whole) - self.before)


class ChangePoints:
    """The recent change points of a belief over all episodes of an adaptation.

    Args:
        space: the hypotheses, with whose prior each change point begins.
    """

    def __init__(self, space: HypothesisSpace) -> None:
        self._space = space
        self._recent: deque[ChangePoint] = deque(maxlen=CHANGE_POINTS)

    def add(self, episode: int, whole: Belief) -> None:
        """Try an episode that begins now as a change point."""
        self._recent.append(ChangePoint(episode, prior_belief(self._space), _evidence(whole)))

    def update(self, observed: Callable[[Belief], Belief]) -> None:
        """Update the belief of each."""
        for number, one in enumerate(self._recent):
            self._recent[number] = replace(one, belief=observed(one.belief))

    def best(self, whole: Belief) -> ChangePoint | None:
        """Return the change point with the highest odds; None: there is none."""
        return max(self._recent, key=lambda one: one.log_odds(whole), default=None)

    def convincing(self, whole: Belief) -> ChangePoint | None:
        """Return the best change point, if its odds are high enough."""
        best = self.best(whole)
        return best if best is not None and best.log_odds(whole) >= CONVINCED else None


def _evidence(belief: Belief) -> float:
    return belief.evidence + UNEXPLAINED * belief.unexplained
