"""Drawing one action at a time: in plain Python, since numpy's calls cost more than a few additions."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate

from merap.mdp.model import Bools, Floats


def draw_action(shares: Floats, allowed: Bools, uniform: float) -> int:
    """An action by inversion, from a policy's row restricted to what is allowed.

    Args:
        shares: float64 [A], at least 0; where nothing of them is allowed, allowed actions are equal.
        allowed: bool [A], not empty.
        uniform: in [0, 1).
    """
    mask = allowed.tolist()
    weights = [share if open_ else 0.0 for share, open_ in zip(shares.tolist(), mask, strict=True)]
    bounds = list(accumulate(weights))
    if bounds[-1] == 0:
        bounds = list(accumulate(map(float, mask)))
    # a product with a number below 1 may still be rounded up to the last bound
    return bisect_right(bounds, min(uniform * bounds[-1], math.nextafter(bounds[-1], 0)))
