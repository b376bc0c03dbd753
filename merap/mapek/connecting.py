"""Connect the system that a scenario names, if it is not simulated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from merap.concerns.case_study import CaseStudy
from merap.mapek.scenario import Scenario
from merap.mapek.scenario_schema import GymnasiumSpec, HttpSpec, LiveSpec
from merap.systems.description import Interface, ShownVariable, shown_variables
from merap.systems.interface import ManagedSystem
from merap.systems.renumbered import RenumberedSystem
from merap.systems.served_dialect import open_served


@contextmanager
def connected(scenario: Scenario, case: CaseStudy, episodes: int = 0) -> Iterator[ManagedSystem | None]:
    """Connect the system of a scenario until the end of the block; None: it is simulated, or the run is over.

    Args:
        scenario: the system.
        case: case of the manager.
        episodes: number of episodes that are over; an environment goes on with other draws than those.

    Raises:
        InputError: the system does not fit the case; names the place in the scenario.
        SystemFault: it can't be reached or does not behave.
    """
    spec = scenario.spec.system
    if episodes >= scenario.spec.episodes:
        yield None
        return
    variables = shown_variables(case.combination_at(0).program)
    if isinstance(spec, HttpSpec):
        names = [variable.name for variable in variables]
        with scenario.document.at("system"):
            remote = open_served(spec.url, timeout=spec.timeout, actions=case.actions, variables=names)
        with remote:
            _require_horizon(scenario, live_horizon(spec, case), remote.interface)
            yield remote
    elif isinstance(spec, GymnasiumSpec):
        with _environment(scenario, spec, case.actions, variables, episodes) as system:
            yield system
    else:
        yield None


@contextmanager
def _environment(
    scenario: Scenario,
    spec: GymnasiumSpec,
    actions: tuple[str, ...],
    variables: tuple[ShownVariable, ...],
    episodes: int,
) -> Iterator[ManagedSystem]:
    seed = int(np.random.SeedSequence([scenario.spec.seed, episodes]).generate_state(1)[0])
    with scenario.document.at("system"):
        from merap.systems.gymnasium import GymnasiumSystem  # noqa: PLC0415  an extra, which may be missing

        environment = GymnasiumSystem(spec.gymnasium, seed=seed, arguments=spec.arguments)
    with environment:
        shown = [variable.name for variable in environment.interface.variables]
        with scenario.document.at("system"):
            system = RenumberedSystem(
                environment,
                shown,
                actions=actions,
                variables=[variable.name for variable in variables],
                constants={one.name: one.low for one in variables if one.low == one.high},
            )
        yield system


def live_horizon(spec: LiveSpec, case: CaseStudy) -> int:
    """Return the steps of an episode of a system that is not simulated."""
    return spec.horizon or case.combination_at(0).objective.horizon


def _require_horizon(scenario: Scenario, expected: int, shown: Interface) -> None:
    if shown.horizon not in {None, expected}:
        message = f"an episode of it has {shown.horizon} steps, not {expected}; say so by horizon"
        raise scenario.document.error(("system",), message)
