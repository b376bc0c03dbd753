from __future__ import annotations

from pathlib import Path

import pytest

from merap.concerns.case_study import load_declared_case
from merap.families.models import built
from merap.mdp.planning import optimum
from scripts.bench.belief_quality import belief_problem, drawn_figures, followed_belief
from scripts.bench.following import CONDITIONS, Lengths, NoiseCondition
from tests.support.paths import MODELS

PAPER = MODELS / "paper-grid"


def test_slip_is_in_the_model_that_scores() -> None:
    case = load_declared_case(PAPER / "rq1-1.yaml")
    problem = belief_problem(case, NoiseCondition("slip", slip=0.1))
    assert problem.truth.reachable.optimum < optimum(built(case.system("met")), 18)


def test_drawn_cases_are_met_once_each(tmp_path: Path) -> None:
    rows = list(drawn_figures((0, 1), CONDITIONS[0], Lengths(4, 12), tmp_path))
    assert [row["case"] for row in rows] == ["drawn_0", "drawn_1"]
    assert all(row["explanation"] for row in rows)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_covered_cases_take_ten_episodes_at_most_with_slip_and_noise(number: int) -> None:
    # Of the bench's 30 seeds each needs 3 at most, so that ten by luck is out of reach. The seeds are fixed.
    problem = belief_problem(load_declared_case(PAPER / f"rq1-{number}.yaml"), CONDITIONS[-1])
    for seed in range(2):
        run, strategy = followed_belief(problem, seed, Lengths(4, 13))
        assert run.episodes_to_within_5_percent is not None
        assert run.episodes_to_within_5_percent <= 10
        assert strategy.belief.unexplained == 0


def test_a_way_that_slips_made_doubtful_is_tried_again(tmp_path: Path) -> None:
    # drawn_97: of the shortest ways that may be open only one is, and a slip there looked like an obstacle.
    # The policy went around for good when the first hope that came to mind was the only one judged.
    (row,) = drawn_figures((97,), CONDITIONS[-1], Lengths(4, 12), tmp_path)
    assert row["episodes"] is not None
