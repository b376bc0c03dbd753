"""The programs that are measured are sound, and both routes agree on them."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from merap.checker.prism_reading import read_prism
from merap.checker.storm import build_text
from merap.program.arrays import tabular
from merap.program.closing import closed
from merap.program.exploration import explore
from merap.program.expressions import Value
from scripts.bench.evidence import slippery_grid
from scripts.bench.program import CHAIN, GRID, export_mapped


@pytest.mark.parametrize("text", [GRID, CHAIN])
def test_storm_builds_the_model_that_is_explored(tmp_path: Path, text: str) -> None:
    path = tmp_path / "model.prism"
    path.write_text(text.format(size=5), encoding="utf-8")
    program = closed(read_prism(path).program, {})
    theirs = export_mapped(build_text(path.read_text(encoding="utf-8"), "measured"))
    assert theirs.variable_names == tuple(one.name for one in program.variables)
    for states in (None, theirs.valuations):
        ours = tabular(program, explore(program, states), reward="objective")
        order = np.lexsort(theirs.valuations.T[::-1])
        assert np.array_equal(ours.valuations, theirs.valuations[order])
        assert ours.num_branches == theirs.num_branches
        assert ours.choice_reward.sum() == pytest.approx(theirs.choice_reward.sum())
        assert ours.labels["goal"].sum() == theirs.labels["goal"].sum() if text == GRID else not ours.labels


@pytest.mark.parametrize("slip", [Fraction(0), Fraction(1, 5)])
def test_the_family_of_the_evidence_has_models(slip: Fraction) -> None:
    values: dict[str, Value] = {
        "rock_row": Fraction(2),
        "rock_col": Fraction(1),
        "slip": slip,
        "drain": Fraction(1, 3),
        "need": Fraction(1),
    }
    program = closed(slippery_grid(4), values)
    mdp = tabular(program, explore(program), reward="earned")
    # without slip nobody gets onto the rock
    assert mdp.num_states == (16 if slip else 15) * 6
