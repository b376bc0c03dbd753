"""Messages and systems that the tests of the loop share."""

from __future__ import annotations

import numpy as np

from merap.online.systems import Observation

NUM_ACTIONS = 5


def seen(
    row: int,
    col: int,
    reward: float = -0.5,
    *,
    ended: bool = False,
    truncated: bool = False,
    enabled: tuple[bool, ...] = (True,) * NUM_ACTIONS,
) -> Observation:
    """An observation on the paper's grid."""
    return Observation(
        valuation=np.array([row, col, 0]),
        enabled=np.array(enabled),
        reward=reward,
        continuation=0.0 if ended else 1.0,
        truncated=truncated,
    )
