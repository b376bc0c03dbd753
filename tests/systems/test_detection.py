from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from merap.belief.posterior import concern_weights, prior_belief
from merap.belief.space import hypothesis_space
from merap.belief.update import observe_detections
from merap.concerns.case_study import load_declared_case
from merap.concerns.combination import DeclaredCombination
from merap.concerns.space import Attribute, Detector
from merap.systems.detection import detections, seen_locations
from tests.support.hand_made import cells, grid_combination, grid_space, with_environment

READINGS = 20_000


def seen_by(combination: DeclaredCombination, *detectors: Detector) -> DeclaredCombination:
    return replace(combination, space=replace(combination.space, detectors=detectors))


def lit(kind: str, low: float, high: float, value: float) -> DeclaredCombination:
    """A 2 x 2 grid with one attribute, equal everywhere."""
    light = Attribute("light", kind, low, high, np.full(4, value))  # type: ignore[arg-type]
    return with_environment(grid_combination(size=2, goal=(1, 1)), attributes=(light,))


def readings_of(
    combination: DeclaredCombination, accuracy: float, seed: int = 0, count: int = READINGS
) -> list[object]:
    sensed = seen_by(combination, Detector("meter", "light", 0, accuracy))
    generator = np.random.default_rng(seed)
    return [detections(sensed, 0, generator)["meter"]["r0c0"] for _ in range(count)]


def assert_share(count: int, probability: float) -> None:
    """Within 4 standard deviations of a binomial; fails by luck with less than 1 in 10,000."""
    deviation = math.sqrt(READINGS * probability * (1 - probability))
    assert abs(count - READINGS * probability) <= 4 * deviation


@pytest.mark.parametrize(
    ("reach", "expected"),
    [
        (0, [(1, 1)]),
        (1, [(0, 1), (1, 0), (1, 1), (1, 2), (2, 1)]),
        (2, [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (1, 3), (2, 0), (2, 1), (2, 2), (3, 1)]),
    ],
)
def test_a_detector_sees_as_many_edges_far_as_its_range(reach: int, expected: list[tuple[int, int]]) -> None:
    found = seen_locations(grid_space((4, 4)), 5, reach)
    assert [divmod(int(location), 4) for location in found] == expected


def test_a_perfect_detector_reads_what_is_there() -> None:
    combination = seen_by(grid_combination(blocked=cells((0, 1), (3, 3))), Detector("lidar", "blocked", 1, 1))
    read = detections(combination, 0, np.random.default_rng(0))
    assert read == {"lidar": {"r0c0": False, "r0c1": True, "r1c0": False}}


def test_a_place_that_cannot_be_entered_is_no_obstacle() -> None:
    combination = seen_by(grid_combination(no_entry=cells((0, 1))), Detector("lidar", "blocked", 1, 1))
    assert not any(detections(combination, 0, np.random.default_rng(0))["lidar"].values())


def test_a_wrong_reading_of_two_values_is_the_other() -> None:
    read = readings_of(lit("bool", 0, 1, 1), 0.9)
    assert set(read) == {True, False}
    assert_share(read.count(False), 0.1)


def test_a_wrong_reading_of_several_values_is_any_other() -> None:
    read = readings_of(lit("int", -1, 2, 1), 0.7)
    assert all(type(value) is int for value in read)
    assert_share(read.count(1), 0.7)
    for other in (-1, 0, 2):
        assert_share(read.count(other), 0.1)


def test_an_attribute_with_one_value_is_read_right() -> None:
    assert set(readings_of(lit("int", 2, 2, 2), 0.5, count=50)) == {2}


def test_a_wrong_reading_of_a_real_attribute_is_anywhere_in_its_range() -> None:
    read = np.array(readings_of(lit("real", 2, 4, 3.5), 0.8), dtype=np.float64)
    wrong = read[read != 3.5]
    assert_share(len(wrong), 0.2)
    assert wrong.min() >= 2
    assert wrong.max() <= 4
    # the mean of a uniform on [2, 4] is 3, its deviation 1 / sqrt(3)
    assert abs(wrong.mean() - 3) <= 4 / math.sqrt(3 * len(wrong))


def test_equal_seeds_give_equal_readings() -> None:
    one, again, other = (readings_of(lit("int", 0, 3, 1), 0.5, seed, 50) for seed in (1, 1, 2))
    assert one == again
    assert one != other


def test_the_belief_weighs_what_is_read_as_often_as_it_is_read() -> None:
    """At hall_sw the lidar reads C, obstructed in two of three environments, right with 0.95.

    Bayes' rule gives, after m readings `blocked` of n, odds of 2 * (0.95/0.05)^(2m - n) for these two
    environments; the belief is asked after each of 40 readings.
    """
    case = load_declared_case("models/running-example")
    space = hypothesis_space(case)
    belief = prior_belief(space)
    b_blocked = case.combine(0, 0, 0)
    location = case.space.location_index["hall_sw"]
    generator = np.random.default_rng(3)
    log_odds = math.log(2)
    for _ in range(40):
        read = detections(b_blocked, location, generator)["lidar"]
        belief = observe_detections(space, belief, {"lidar": {"C": read["C"]}})
        log_odds += math.log(19) if read["C"] else -math.log(19)
        environment, _, _ = concern_weights(space, belief)
        if abs(log_odds) < 20:  # beyond, the belief drops what is negligible
            assert environment[1:3].sum() / environment[0] == pytest.approx(math.exp(log_odds), rel=1e-6)
    assert log_odds < -20
    assert environment[1:3].sum() < 1e-6
