from __future__ import annotations

from pathlib import Path

import pytest

from merap.base.build import model_of
from merap.concerns.case_study import load_case
from merap.experiments.belief_quality import (
    CONDITIONS,
    Condition,
    Lengths,
    case_figures,
    drawn_figures,
    followed,
    meeting,
    outside_of,
)
from merap.mdp.planning import optimum

PAPER = Path(__file__).parents[1] / "models" / "paper-grid"


@pytest.mark.parametrize(("number", "outside"), [(1, ""), (4, ""), (5, "O"), (6, "E"), (7, "C"), (8, "ECO")])
def test_what_lies_outside_the_base_is_as_the_paper_says(number: int, outside: str) -> None:
    # shared/paper, RQ1: cases 1 to 4 are covered, 5 to 8 are not, by goal, environment, capability and all.
    assert outside_of(load_case(PAPER / f"rq1-{number}.yaml")) == outside


def test_slip_is_in_the_model_that_scores() -> None:
    case = load_case(PAPER / "rq1-1.yaml")
    met = meeting(case, Condition("slip", slip=0.1))
    assert met.reachable.optimum < optimum(model_of(case.system("met")), 18)


def test_a_row_for_each_condition() -> None:
    rows = list(case_figures(load_case(PAPER / "rq1-3.yaml"), CONDITIONS[::3], range(2), Lengths(4, 12)))
    assert [row["condition"] for row in rows] == ["none", "both"]
    for row in rows:
        assert row["runs"] == 2
        assert row["never_episodes_to_within_5_percent"] == 0


def test_drawn_cases_are_met_once_each(tmp_path: Path) -> None:
    rows = list(drawn_figures((0, 1), CONDITIONS[0], Lengths(4, 12), tmp_path))
    assert [row["case"] for row in rows] == ["drawn_0", "drawn_1"]
    assert all(row["explanation"] for row in rows)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_covered_cases_take_ten_episodes_at_most_with_slip_and_noise(number: int) -> None:
    # Of the bench's 30 seeds each needs 3 at most, so that ten by luck is out of reach. The seeds are fixed.
    met = meeting(load_case(PAPER / f"rq1-{number}.yaml"), CONDITIONS[-1])
    for seed in range(2):
        run, strategy = followed(met, seed, Lengths(4, 13))
        assert run.episodes_to_within_5_percent is not None
        assert run.episodes_to_within_5_percent <= 10
        assert strategy.belief.unexplained == 0
