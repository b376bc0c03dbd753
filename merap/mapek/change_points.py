"""Whether what is learned in an adaptation still holds: rivals that forgot what was seen before an episode.

A change amid an adaptation is explained away by a belief that has seen both sides of it: what was refuted
before stays refuted, and a false compromise is left. So at the beginning of each episode a rival begins from
the prior, and what is seen from there on is held against both:

    O_k = p(what is seen since episode k | the prior) / p(the same | what was seen before it)

Without a change, for a system drawn from the prior, each O_k is a martingale with a mean of 1: it ever
exceeds c with a probability of at most 1 / c (Ville). O_k is the Bayes factor of a change point at k (Adams
and MacKay 2007, "Bayesian online changepoint detection"). The last few episodes have a rival each.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from merap.belief.posterior import Belief, prior_belief
from merap.belief.space import HypothesisSpace

# So many of the last episodes have a rival.
RIVALS = 3
# Log-odds of a change from which on it is believed: with e^12 one adaptation in some 10,000, of ten
# episodes and more, begins anew for nothing.
CONVINCED = 12.0
# Nats of an observation that no hypothesis allows.
UNEXPLAINED = -12.0


@dataclass(frozen=True, eq=False)
class Rival:
    """A belief that began with an episode.

    Attributes:
        episode: the first that it has seen.
        belief: its posterior.
        before: evidence of the incumbent when it began.
    """

    episode: int
    belief: Belief
    before: float

    def log_odds(self, incumbent: Belief) -> float:
        """Of what was seen since it began: from the prior, to what was learned before."""
        return _evidence(self.belief) - (_evidence(incumbent) - self.before)


class Rivals:
    """The rivals of an incumbent belief.

    Args:
        space: the hypotheses, whose prior the rivals begin with.
    """

    def __init__(self, space: HypothesisSpace) -> None:
        self._space = space
        self._rivals: deque[Rival] = deque(maxlen=RIVALS)

    def begin(self, episode: int, incumbent: Belief) -> None:
        """An episode begins."""
        self._rivals.append(Rival(episode, prior_belief(self._space), _evidence(incumbent)))

    def observe(self, update: Callable[[Belief], Belief]) -> None:
        """All of them have seen something."""
        for number, rival in enumerate(self._rivals):
            self._rivals[number] = replace(rival, belief=update(rival.belief))

    def best(self, incumbent: Belief) -> Rival | None:
        """The rival with the highest odds; None: there is none."""
        return max(self._rivals, key=lambda rival: rival.log_odds(incumbent), default=None)

    def convincing(self, incumbent: Belief) -> Rival | None:
        """The best rival, if its odds are high enough."""
        best = self.best(incumbent)
        return best if best is not None and best.log_odds(incumbent) >= CONVINCED else None


def _evidence(belief: Belief) -> float:
    return belief.evidence + UNEXPLAINED * belief.unexplained
