"""Slip of a case with processes, against two independent routes: Storm, and fractions in pure Python."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from merap.checker.storm import build_text
from merap.concerns.case_study import load_declared_case
from merap.concerns.combination import DeclaredCombination
from merap.errors import InputError
from merap.mdp.comparison import compare
from merap.prism.program_text import render_program
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.systems.simulated import SimulatedSystem
from merap.systems.slip import slipping
from tests.support.process_cases import SERVICE
from tests.support.program_enumeration import State, enumerate_model

SLIP = Fraction(1, 10)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> DeclaredCombination:
    path = tmp_path_factory.mktemp("case") / "service.yaml"
    path.write_text(SERVICE, encoding="utf-8")
    return load_declared_case(path).combination("rush.slow.quality")


def slipped(now: Mapping[str, Any]) -> dict[str, Any]:
    """What a step that does nothing makes of a state: the monitor sees that the load stays what it is."""
    return {**now, "seen": 1 if now["load"] == 4 else now["seen"]}


def expected(service: DeclaredCombination) -> dict[State, dict[str, dict[State, Fraction]]]:
    """Mix every step with the one that does nothing; there is no program of it."""
    program = service.program
    names = [variable.name for variable in program.variables]
    _, choices = enumerate_model(program)
    found: dict[State, dict[str, dict[State, Fraction]]] = {}
    for state, steps in choices.items():
        still = slipped(dict(zip(names, state, strict=True)))
        there = tuple(still[name] for name in names)
        for action, successors in steps:
            assert action is not None
            mixed = {target: (1 - SLIP) * chance for target, chance in successors.items()}
            mixed[there] = mixed.get(there, Fraction(0)) + SLIP
            found.setdefault(state, {})[action] = mixed
    return found


def test_every_step_is_mixed_with_one_that_does_nothing(service: DeclaredCombination) -> None:
    program = slipping(service.program, float(SLIP))
    assert [one.name for one in program.variables] == [one.name for one in service.program.variables]
    _, choices = enumerate_model(program)
    found = {state: dict(steps) for state, steps in choices.items()}
    assert found == expected(service)


def test_storm_builds_the_same_from_its_text(service: DeclaredCombination) -> None:
    program = slipping(service.program, float(SLIP))
    whole = tabular(program, explore(program), reward="objective")
    built = build_text(render_program(program, ()), program.name).mdp()
    compare(built, whole).require_same()


def test_without_slip_nothing_is_different(service: DeclaredCombination) -> None:
    assert slipping(service.program, 0.0) is service.program


def test_a_step_that_slips_earns_what_its_state_says(service: DeclaredCombination) -> None:
    """`-4 max(load - running, 0) - running` is paid by every step, those that do nothing included."""
    system = SimulatedSystem(service, 200, np.random.default_rng(0), slip=0.5)
    system.reset()
    for _ in range(200):
        values = system.values
        assert values is not None
        earned = system.step(system.actions.index("keep")).reward
        assert earned == -4 * max(values["load"] - values["running"], 0) - values["running"]


@pytest.mark.parametrize("slip", [-0.1, 1.0, float("nan")])
def test_no_probability_below_one_is_refused(service: DeclaredCombination, slip: float) -> None:
    with pytest.raises(InputError, match=r"slip must be in \[0, 1\)"):
        slipping(service.program, slip)
