from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.belief.explanation import summarise
from merap.belief.posterior import concern_weights, prior_belief
from merap.belief.space import hypothesis_space
from merap.belief.strategy import BeliefStrategy
from merap.belief.update import observe_detections
from merap.concerns.case_study import load_declared_case
from merap.concerns.combination import ResetMode
from merap.mdp.model import Floats
from merap.strategies.protocol import episode
from merap.systems.detection import detections
from merap.systems.simulated import SimulatedSystem
from tests.support.belief_routes import STRIP
from tests.support.case_examples import GRAPH, write_case
from tests.support.paths import MODELS

RUNNING = MODELS / "running-example"
SENSING = STRIP.replace(
    "right: [0, 1]}}\n",
    "right: [0, 1]}}\n  detectors: {sonar: {of: blocked, range: 1, accuracy: 0.8}}\n",
)
# The slope at A is 0.5 in `open` and 0.75 in `dim`, and there is a sensor for it.
SLOPING = (
    GRAPH.replace("accuracy: 0.95}\n", "accuracy: 0.95}\n    level: {of: slope, range: 0, accuracy: 0.7}\n")
    .replace("lamp: int}", "lamp: int, tilt: real}")
    .replace("light: {A: lamp}", "light: {A: lamp}, slope: {A: tilt}")
    .replace("lamp: 3}", "lamp: 3, tilt: 0.5}")
    .replace("lamp: 1}", "lamp: 1, tilt: 0.75}")
    .replace("lamp: 0}", "lamp: 0, tilt: 0}")
)


def test_the_weights_after_readings_are_as_right_as_the_detector(tmp_path: Path) -> None:
    # Calibration: readings are drawn by the other module. Over draws from the prior, the weight that the
    # belief gives to what is there averages to the mean of the squared weights (both are E[sum w^2]).
    case = load_declared_case(write_case(tmp_path, SENSING))
    space = hypothesis_space(case)
    generator = np.random.default_rng(0)
    right, expected = [], []
    for _ in range(400):
        actual = int(generator.integers(case.shape[0]))
        belief = prior_belief(space)
        for _ in range(2):
            readings = detections(case.combine(actual, 0, 0), 0, generator)
            belief = observe_detections(space, belief, readings)
        environment = concern_weights(space, belief)[0][: case.shape[0]]
        shares: Floats = environment / environment.sum()
        right.append(shares[actual])
        expected.append(shares @ shares)
    error = np.std(np.array(right) - np.array(expected)) / np.sqrt(len(right))
    # Four standard errors: by luck alone it fails with a chance of 6e-5.
    assert abs(np.mean(right) - np.mean(expected)) < 4 * error
    assert np.mean(right) > 0.55


def test_a_reading_of_a_real_attribute_is_right_or_means_nothing(tmp_path: Path) -> None:
    space = hypothesis_space(load_declared_case(write_case(tmp_path, SLOPING)))
    prior = prior_belief(space)
    before = concern_weights(space, prior)[0]
    of_none = concern_weights(space, observe_detections(space, prior, {"level": {"A": 0.123}}))[0]
    np.testing.assert_allclose(of_none, before)
    dim = space.environment_names.index("dim")
    of_dim = concern_weights(space, observe_detections(space, prior, {"level": {"A": 0.75}}))[0]
    assert of_dim[dim] > 1 - 1e-6


def test_a_lidar_lays_the_blame_on_the_environment() -> None:
    case = load_declared_case(RUNNING)
    space, system = hypothesis_space(case), case.system("met")
    horizon = system.objective.horizon
    outside = []
    for detect in (False, True):
        strategy = BeliefStrategy(space, horizon, np.random.default_rng(0))
        simulated = SimulatedSystem(system, horizon, np.random.default_rng(1), detect=detect)
        for _ in range(3):
            episode(simulated, strategy)
            strategy.update()
        assert strategy.belief.unexplained == 0
        outside.append(summarise(space, strategy.belief).outside["environment"])
    # A is blocked, which no environment of the base has. Without a detector the capability may be to
    # blame; a dozen readings of accuracy 0.95 leave that a chance below 1e-6 but for one seed in 10^4.
    assert outside[0] < 0.9
    assert outside[1] > 0.99


@pytest.mark.parametrize("reset", ["return_to_start", "none"])
def test_systems_that_can_not_be_reset_are_learned_about_too(reset: ResetMode) -> None:
    case = load_declared_case(RUNNING)
    space, system = hypothesis_space(case), case.system("met")
    horizon = system.objective.horizon
    strategy = BeliefStrategy(space, horizon, np.random.default_rng(0))
    simulated = SimulatedSystem(system, horizon, np.random.default_rng(1), reset=reset)
    for _ in range(4):
        episode(simulated, strategy)
        strategy.update()
    assert strategy.belief.unexplained == 0
    name, weight = summarise(space, strategy.belief).objective[0]
    assert name == "g3"
    assert weight == pytest.approx(1)
