"""The two routes to the model of a combination, and to the value of its best policy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.combination_model import build_combination
from merap.checker.properties import REWARD, properties
from merap.families.loading import load_case
from merap.families.models import explored
from merap.mdp.comparison import compare
from merap.mdp.planning import optimum
from tests.support.shipped_cases import CASE_FILES

# Members of a case that are all compared; of a larger one, as many are drawn.
COMPARED = 100


@pytest.mark.slow
@pytest.mark.parametrize("path", CASE_FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_storm_and_merap_agree_on_shipped_cases(path: Path) -> None:
    """Equal models; equal discounted rewards within the horizon, Storm's against backward induction."""
    case = load_case(path)
    for member in [*case.sample(COMPARED, np.random.default_rng(0)), *case.systems.values()]:
        ours, storms = explored(member), build_combination(member)
        compare(ours, storms.mdp).require_same()
        assert ours.labels.keys() <= storms.mdp.labels.keys()
        answer = storms.storm.check(properties(member)[REWARD], storms.mdp.initial)
        planned = optimum(ours, member.objective.horizon, member.discount)
        assert answer.value == pytest.approx(planned, abs=1e-6)
        assert answer.lower is not None
        assert answer.upper is not None
        assert answer.lower - 1e-6 <= planned <= answer.upper + 1e-6
