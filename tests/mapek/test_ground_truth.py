"""What is really there at each stage, as the report has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.concerns.case_study import load_case
from merap.concerns.combination import Combination, Condition
from merap.mapek.ground_truth import Truth, truths
from merap.mapek.scenario import Moment, Stage
from merap.shield.supervision import unsafe_of


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


@pytest.mark.parametrize("threshold", [None, 0.0, 0.05])
def test_from_where_it_starts_anyway_nothing_is_different(
    system: Combination, threshold: float | None
) -> None:
    found = truth(system, threshold, 0.1)
    (start,) = np.flatnonzero(found.model.initial)
    there = found.starting(int(start))
    assert there.reachable == found.reachable
    assert there.discounted_optimum == found.discounted_optimum
    assert (there.safe_optimum is None) == (threshold is None)
    if threshold is not None:
        assert there.safe_optimum == pytest.approx(found.safe_optimum)


def test_from_the_goal_stopping_is_all_that_is_left(system: Combination) -> None:
    """`met` has its goal in the corner (5, 6), where stopping earns 20."""
    there = truth(system, 0.0).starting(5 * 7 + 6)
    assert there.reachable.optimum == pytest.approx(20)
    assert there.safe_optimum == pytest.approx(20)
    stop = np.tile(np.eye(5)[0], (there.model.num_states, 1))
    assert there.value(stop) == pytest.approx(20)
