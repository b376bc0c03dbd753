"""Every combination by three routes: plain enumeration of the file, merap's exploration, Storm."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap import load_case
from merap.concerns.combination import Combination
from merap.families.models import built, explored
from merap.mdp.comparison import compare
from tests.support.case_enumeration import enumerate_case, read_case_file
from tests.support.case_examples import GRAPH, GRID, write_case
from tests.support.case_routes import of_arrays, of_enumeration
from tests.support.feature_cases import FEATURES
from tests.support.objective_cases import COURIER, PUMP
from tests.support.process_cases import SERVICE
from tests.support.shipped_cases import DECLARED_CASE_FILES

OWN = {"a grid": GRID, "a graph": GRAPH, "a service": SERVICE, "a pump": PUMP, "a courier": COURIER}
SMALL = FEATURES | OWN
MEMBERS = 18  # at most, of each shipped case: an enumeration takes up to two seconds


def require_equal_routes(combination: Combination, source: Path) -> None:
    """Compare the three routes of a combination."""
    parameters = {
        concern: getattr(combination, concern).parameters
        for concern in ("environment", "capability", "objective")
    }
    content = read_case_file(source)
    content["objective"] |= content.get("online", {}).get(combination.name, {})  # their start and horizon
    enumerated = enumerate_case(content, parameters)
    mdp = explored(combination)
    assert of_arrays(combination, mdp, enumerated.names) == of_enumeration(enumerated)
    assert combination.objective.horizon == enumerated.horizon
    assert combination.discount == enumerated.discount
    compare(built(combination), mdp).require_same()


@pytest.mark.parametrize("feature", SMALL)
def test_small_cases(feature: str, tmp_path: Path) -> None:
    path = write_case(tmp_path, SMALL[feature])
    case = load_case(path)
    for combination in (*case.combinations(), *case.systems.values()):
        require_equal_routes(combination, path)


@pytest.mark.slow
@pytest.mark.parametrize("path", DECLARED_CASE_FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_members_and_systems_of_shipped_cases(path: Path) -> None:
    case = load_case(path)
    for combination in (*case.sample(MEMBERS, generator=0), *case.systems.values()):
        require_equal_routes(combination, path)
