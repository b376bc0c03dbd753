"""Systems that `merap serve` offers: a combination of a case, or a scenario in which it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination, ResetMode
from merap.mapek.scenario import Scenario
from merap.mapek.scenario_system import ScenarioSystem
from merap.systems.description import interface_of
from merap.systems.served import Pace, ServedSystem
from merap.systems.simulated import SimulatedSystem


def served_combination(
    combination: Combination,
    generator: np.random.Generator,
    *,
    slip: float = 0.0,
    noise: float = 0.0,
    detect: bool = True,
    reset: ResetMode | None = None,
    pace: Pace | None = None,
) -> ServedSystem:
    """Return a simulated combination to serve; see `SimulatedSystem`.

    Args:
        combination: the system.
        generator: draws everything.
        slip: probability that an action does nothing.
        noise: standard deviation of the Gaussian noise on rewards.
        detect: whether the case's detectors are read.
        reset: how an episode begins; None: as the case says.
        pace: None: it waits for its manager.

    Raises:
        InputError: a number is out of range, or there is no such action to fall back on.
    """
    simulated = SimulatedSystem(
        combination,
        combination.objective.horizon,
        generator,
        slip=slip,
        noise=noise,
        detect=detect,
        reset=reset or combination.reset,
    )
    return ServedSystem(simulated, interface_of(combination, detect=detect), pace=pace)


def served_scenario(
    case: CaseStudy, scenario: Scenario, *, detect: bool = True, pace: Pace | None = None
) -> ServedSystem:
    """Return a system to serve that changes as a scenario says, with its noise, slip, reset and seed.

    The sensing, strategy and episodes of the scenario are for a loop, and not used.

    Args:
        case: case of the scenario.
        scenario: the system, and its changes.
        detect: whether the case's detectors are read.
        pace: None: it waits for its manager.

    Raises:
        InputError: the scenario does not fit the case; names file and line. There is no such action to
            fall back on.
    """
    spec = scenario.spec
    stages = scenario.stages(case)
    system = ScenarioSystem(stages, spec.noise, spec.reset, np.random.default_rng(spec.seed))
    interface = interface_of(stages[0].system, detect=detect)
    return ServedSystem(system, replace(interface, system=spec.scenario), pace=pace)
