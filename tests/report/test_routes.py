"""Two routes to every shipped model: what Storm builds from the text, and the definition.

Every combination of an enumerated case and a random hundred of a generated one, each also met
online: equal states, enabled actions, probabilities (1e-12) and expected rewards (1e-9); equal
optimal bounded rewards (1e-6), Storm's against backward induction.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.combination_model import build_combination
from merap.checker.properties import REWARD, properties
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.comparison import compare
from merap.mdp.planning import optimum
from tests.support.paths import MODELS

CASES = [
    *(MODELS / name for name in ("running-example", "hazard-grid", "frozen-lake")),
    *sorted((MODELS / "paper-grid").glob("*.yaml")),
]
DRAWN = 100


def chosen(case: CaseStudy) -> list[Combination]:
    return [*case.sample(DRAWN, np.random.default_rng(0)), *case.systems.values()]


def test_all_cases_are_there() -> None:
    # the paper's Table I, its eight RQ1 experiments, and the holes
    assert len(CASES) == 11


@pytest.mark.slow
@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_storm_and_the_definition_agree(path: Path) -> None:
    for combination in chosen(load_case(path)):
        built = build_combination(combination)
        definition = explored(combination)
        compare(built.mdp, definition, probability_tolerance=1e-12, reward_tolerance=1e-9).require_same()
        answer = built.storm.check(properties(combination)[REWARD], built.mdp.initial)
        planned = optimum(definition, combination.objective.horizon, combination.discount)
        assert answer.value == pytest.approx(planned, abs=1e-6)
        assert answer.lower is not None
        assert answer.upper is not None
        assert answer.lower - 1e-6 <= planned <= answer.upper + 1e-6
