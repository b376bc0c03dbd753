"""The two routes to the model of a combination."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.families.loading import load_case
from merap.families.models import built, explored
from merap.mdp.comparison import compare
from tests.support.shipped_cases import CASE_FILES

# Members of a case that are all compared; of a larger one, a hundred are drawn.
ENUMERATED = 100


@pytest.mark.slow
@pytest.mark.parametrize("path", CASE_FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_exploration_equals_storm_on_the_members_of_shipped_cases(path: Path) -> None:
    case = load_case(path)
    members = (
        list(case.combinations()) if case.size <= ENUMERATED else case.sample(100, np.random.default_rng(0))
    )
    for member in [*members, *case.systems.values()]:
        ours, storms = explored(member), built(member)
        compare(ours, storms).require_same()
        assert ours.labels.keys() == storms.labels.keys()
