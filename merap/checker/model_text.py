"""Render a combination as the text that a checker gets."""

from __future__ import annotations

import numpy as np

from merap.checker.exchange import ModelText
from merap.concerns.combination import Combination
from merap.prism.rendering import render


def model_text(combination: Combination) -> ModelText:
    """Render a combination."""
    starts = np.flatnonzero(combination.objective.start)
    return ModelText(
        name=combination.name,
        text=render(combination),
        variables=combination.space.variable_names,
        starts=combination.space.valuations[starts],
        weights=combination.objective.start[starts],
    )
