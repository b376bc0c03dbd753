"""A simulated system as it really is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.concerns.case_study import load_declared_case
from merap.concerns.combination import DeclaredCombination
from merap.mdp.index import new_index
from merap.strategies.ground_truth import GroundTruth, ground_truth


@pytest.fixture(scope="module")
def system() -> DeclaredCombination:
    return load_declared_case("models/hazard-grid").system("met")


def safe_value(truth: GroundTruth) -> float:
    assert truth.safe_optimum is not None
    return truth.safe_optimum.value


def test_without_a_shield_there_is_one_optimum(system: DeclaredCombination) -> None:
    assert ground_truth(system).safe_optimum is None


def test_the_optimum_rises_with_the_threshold_to_the_free_one(system: DeclaredCombination) -> None:
    found = [ground_truth(system, 0.0, threshold) for threshold in (0.0, 0.1, 1.0)]
    safe = [safe_value(one) for one in found]
    assert safe[0] < safe[1] < found[2].reachable.optimum
    assert safe[2] == pytest.approx(found[2].reachable.optimum)


def test_who_never_visits_a_hole_does_not_mind_that_it_ends_the_task(system: DeclaredCombination) -> None:
    """A completed task has no place on the index of the case; the optimum within 0 sees it all the same."""
    ending = replace(system, objective=replace(system.objective, ends_in=system.objective.unsafe))
    there, here = ground_truth(ending, 0.0, 0.0), ground_truth(system, 0.0, 0.0)
    assert safe_value(there) == pytest.approx(safe_value(here))
    assert there.reachable.optimum != pytest.approx(here.reachable.optimum)


@pytest.mark.parametrize("threshold", [None, 0.0, 0.05])
def test_from_where_it_starts_anyway_nothing_is_different(
    system: DeclaredCombination, threshold: float | None
) -> None:
    found = ground_truth(system, 0.1, threshold)
    (start,) = np.flatnonzero(found.whole.initial)
    there = found.starting(found.worlds.started.values(int(start)))
    assert there.reachable == found.reachable
    assert there.discounted_optimum == found.discounted_optimum
    assert (there.safe_optimum is None) == (threshold is None)
    if threshold is not None:
        assert safe_value(there) == pytest.approx(safe_value(found))


def test_from_the_goal_stopping_is_all_that_is_left(system: DeclaredCombination) -> None:
    """`met` has its goal in the corner (5, 6), where stopping earns 20."""
    there = ground_truth(system, 0.0, 0.0).starting({"row": 5, "col": 6, "mode": 0, "done": 0})
    assert there.reachable.optimum == pytest.approx(20)
    assert safe_value(there) == pytest.approx(20)
    index = new_index(("row", "col", "mode"), system.actions)
    assert there.value(np.zeros((0, 5)), index) < 20  # it says nothing: any action is as likely
    known = index.extended(there.whole)
    stop = np.tile(np.eye(5)[0], (known.num_states, 1))
    assert there.value(stop, known) == pytest.approx(20)
