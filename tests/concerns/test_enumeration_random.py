"""Random case files by three routes: they agree on the model, or all refuse it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from merap import load_case
from merap.errors import InputError, ModelError
from merap.families.models import built, explored
from merap.mdp.comparison import compare
from tests.support.case_enumeration import enumerate_case
from tests.support.case_examples import write_case
from tests.support.case_routes import of_arrays, of_enumeration
from tests.support.random_cases import Case, random_cases


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(random_cases())
def test_random_cases(tmp_path: Path, case: Case) -> None:
    combination = load_case(write_case(tmp_path, json.dumps(case))).combination_at(0)
    values = {"environment": case["environment"]["configurations"]["e"], "capability": {}, "objective": {}}
    try:
        enumerated = enumerate_case(case, values)
    except AssertionError:
        with pytest.raises((InputError, ModelError)):
            explored(combination)
        with pytest.raises((InputError, ModelError)):
            built(combination)
        return
    mdp = explored(combination)
    assert of_arrays(combination, mdp, enumerated.names) == of_enumeration(enumerated)
    compare(built(combination), mdp).require_same()
