"""Evidence of a change at one state and action alone.

Where a way is blocked or a tool is broken all else is as it was; what is watched for everywhere loses there
what it gains here. So each state and action ("place") has its own odds O of having changed: at every visit a
change may come, with a small chance c, in one of H ways with likelihood ratios l:

    O_h <- l_h (O_h + c / H) / (1 - c)

What is expected of the next visit then mixes the model with the H ways, and the likelihood ratio of that is

    (1 - c) (1 + sum of O after the visit) / (1 + sum of O before it)

whose mean is at most 1 while the model holds, as that of each l is.
"""

from __future__ import annotations

import math

import numpy as np

from merap.mdp.model import Floats


class LocalOdds:
    """The odds of every place, visit by visit.

    Args:
        chance: c.
    """

    def __init__(self, chance: float) -> None:
        self._chance = chance
        self._log_odds: dict[int, Floats] = {}

    def observe(self, place: int, log_ratios: Floats) -> float:
        """Logarithm of the likelihood ratio of a visit.

        Args:
            place: state and action.
            log_ratios: float64 [H], of each way it may have changed.
        """
        before = self._log_odds.get(place, np.full(len(log_ratios), -np.inf))
        coming = math.log(self._chance / len(log_ratios))
        after = log_ratios + np.logaddexp(before, coming) - math.log1p(-self._chance)
        self._log_odds[place] = after
        return math.log1p(-self._chance) + _with_none(after) - _with_none(before)


def _with_none(log_odds: Floats) -> float:
    return float(np.logaddexp(0.0, np.logaddexp.reduce(log_odds)))
