from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.families.models import built
from merap.mdp.planning import optimum
from scripts.bench.drawn_grids import SIZES, drawn_case, drawn_text
from scripts.bench.following import outside_of

NUMBERS = range(40)


@pytest.mark.parametrize("number", range(0, 40, 5))
def test_what_is_met_can_reach_its_goal_in_time(tmp_path: Path, number: int) -> None:
    case = drawn_case(number, tmp_path)
    assert case.warnings == ()
    size = case.space.num_locations**0.5
    system = case.system("met")
    assert size in SIZES
    assert system.objective.horizon == 2 * size
    # The reward of the goal is 10 and a step costs 0.5: without the goal an episode costs the size.
    assert optimum(built(system), system.objective.horizon) > -size


def test_a_number_repeats_itself_and_another_differs() -> None:
    assert drawn_text(3) == drawn_text(3)
    assert drawn_text(3) != drawn_text(4)


def test_every_kind_of_surprise_and_every_size_is_drawn(tmp_path: Path) -> None:
    # Eight kinds of equal chance: of 40 draws, one is missing with a chance of 8 * (7/8)^40 = 4 %, and
    # one of nine sizes with 9 * (8/9)^40 = 8 %. The numbers are fixed: what passes once passes always.
    cases = [drawn_case(number, tmp_path) for number in NUMBERS]
    assert {outside_of(case) for case in cases} == {"", "E", "C", "O", "EC", "EO", "CO", "ECO"}
    assert {round(case.space.num_locations**0.5) for case in cases} == set(SIZES)
    shares = np.mean([["E" in outside_of(case), "C" in outside_of(case)] for case in cases], axis=0)
    assert np.all(np.abs(shares - 0.5) < 0.25)
