"""The shortest path to a set of states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.graph import fewest_steps
from tests.support.paths import MODELS


def test_the_fewest_steps_are_those_of_the_grid() -> None:
    """RQ1-3: from (0, 0) to (4, 4) past one cell; eight steps on every way that is as short as can be."""
    for combination in load_case(MODELS / "paper-grid" / "rq1-3.yaml").combinations():
        model = explored(combination)
        assert fewest_steps(model, model.labels["goal"]) == 8
        assert fewest_steps(model, model.initial > 0) == 0
        assert fewest_steps(model, np.zeros(model.num_states, dtype=np.bool_)) == np.inf


def test_of_several_starts_the_nearest_counts() -> None:
    (combination, *_) = load_case(MODELS / "paper-grid" / "rq1-3.yaml").combinations()
    model = explored(combination)
    row, column = (model.variable_names.index(name) for name in ("row", "col"))
    near = (model.valuations[:, row] == 4) & (model.valuations[:, column] == 2) & ~model.labels["done"]
    both = np.where((model.initial > 0) | near, 0.5, 0.0)
    assert fewest_steps(replace(model, initial=both), model.labels["goal"]) == pytest.approx(2)
