"""What is really there, where it is not quite what was stated."""

from __future__ import annotations

import numpy as np

from merap.mdp.model import Floats
from scripts.bench.trigger_delay import World
from scripts.bench.trigger_streams import gaussian

NOISE = 0.5
# Student's t with three degrees of freedom has a standard deviation of sqrt(3).
HEAVY = 3


def heavy_tailed(generator: np.random.Generator, count: int) -> Floats:
    """Noise of the stated standard deviation, but with large outliers."""
    drawn: Floats = NOISE / np.sqrt(HEAVY) * generator.standard_t(HEAVY, count)
    return drawn


WORLDS = {
    "as stated": World(),
    "noise half of what is stated": World(real_noise=gaussian(NOISE / 2)),
    "noise twice what is stated": World(real_noise=gaussian(NOISE * 2)),
    "heavy-tailed noise": World(real_noise=heavy_tailed),
    "less slip": World(real_slip=0.05),
    "more slip": World(real_slip=0.15),
    "lost steps": World(lost=0.1),
    "stated as symmetric": World(tails="symmetric"),
    "symmetric, noise twice what is stated": World(real_noise=gaussian(NOISE * 2), tails="symmetric"),
    "symmetric, heavy-tailed noise": World(real_noise=heavy_tailed, tails="symmetric"),
}
