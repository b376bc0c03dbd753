"""What a caller may verify: cases, their paths, combinations."""

from __future__ import annotations

import pytest

from merap.errors import InputError
from merap.families.loading import load_case
from merap.families.verification import verify
from tests.support.hand_made import grid_combination
from tests.support.paths import MODELS


def test_a_case_and_one_combination_are_taken_as_they_are() -> None:
    case = load_case(MODELS / "paper-grid" / "rq1-3.yaml")
    assert len({verdict.combination for verdict in verify(case, only="reach")}) == case.size
    assert [verdict.name for verdict in verify(grid_combination(), only="reach")] == ["reach"]


def test_what_is_no_combination_is_one_line() -> None:
    for wrong in (5, [5], {"a": 1}):
        with pytest.raises(InputError, match=r"expected a (case or )?combination"):
            list(verify(wrong))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        list(verify("nowhere.yaml"))


def test_the_path_of_a_case_is_taken_too() -> None:
    path = MODELS / "paper-grid" / "rq1-3.yaml"
    assert list(verify(str(path), only="reach")) == list(verify(path, only="reach"))
