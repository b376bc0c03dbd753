"""What is really there at each stage, as the report has it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from merap.concerns.case_study import load_case
from merap.concerns.combination import Combination, Condition
from merap.online.loop.scenario import Moment, Stage
from merap.online.loop.truth import Truth, truths
from merap.online.shield.supervision import unsafe_of


@pytest.fixture(scope="module")
def system() -> Combination:
    return load_case("models/hazard-grid").system("met")


def truth(system: Combination, threshold: float | None, slip: float = 0.0) -> Truth:
    (found,) = truths([Stage(Moment(0), (), system)], slip, threshold)
    return found


def test_without_a_shield_there_is_one_optimum(system: Combination) -> None:
    assert truth(system, None).safe_optimum is None


def test_the_optimum_rises_with_the_threshold_to_the_free_one(system: Combination) -> None:
    found = [truth(system, threshold) for threshold in (0.0, 0.1, 1.0)]
    safe = [one.safe_optimum for one in found]
    assert safe[0] is not None
    assert safe[1] is not None
    assert safe[0] < safe[1] < found[2].reachable.optimum
    assert safe[2] == pytest.approx(found[2].reachable.optimum)


def test_who_never_visits_a_hole_does_not_mind_that_it_ends_the_task(system: Combination) -> None:
    """A completed task has no place on the canonical index; the optimum within 0 sees it all the same."""
    unsafe = unsafe_of(system)
    assert unsafe is not None
    ending = replace(system, objective=replace(system.objective, ends_in=Condition(at=unsafe)))
    assert truth(ending, 0.0).safe_optimum == pytest.approx(truth(system, 0.0).safe_optimum)
    assert truth(ending, 0.0).reachable.optimum != pytest.approx(truth(system, 0.0).reachable.optimum)
