"""A simulated case with processes: what is seen, what lasts, what changes."""

from __future__ import annotations

import json
from pathlib import Path

import httpx
import numpy as np
import pytest

from merap.concerns.case_study import CaseStudy
from merap.errors import InputError
from merap.families.loading import load_case
from merap.systems.description import ShownVariable, interface_of
from merap.systems.http_server import server
from merap.systems.served import ServedSystem
from merap.systems.served_dialect import open_served
from merap.systems.simulated import SimulatedSystem
from tests.support.case_examples import write_case
from tests.support.http_servers import running
from tests.support.process_cases import SERVICE

# Shrinking ends the task; an alarm is raised by growing and stays.
ENDING = SERVICE.replace(
    "  configurations:\n    calm",
    "    alarm: {type: bool, initial: false, changes: [{action: grow, set: true}]}\n"
    "  configurations:\n    calm",
) + ("  ends_after: {action: shrink}\n")
KEEP, GROW, SHRINK = range(3)


@pytest.fixture
def case(tmp_path: Path) -> CaseStudy:
    return load_case(write_case(tmp_path, ENDING))


def simulated(case: CaseStudy, member: str = "rush.fast.thrift", **settings: object) -> SimulatedSystem:
    return SimulatedSystem(case.combination(member), 30, np.random.default_rng(0), **settings)  # type: ignore[arg-type]


def shrunk(system: SimulatedSystem) -> None:
    """Grow once and shrink as soon as it is done, which ends the task."""
    found = system.step(GROW)
    while not found.enabled[SHRINK]:
        found = system.step(KEEP)
    assert system.step(SHRINK).continuation == 0


def test_all_variables_are_seen_but_the_flag(case: CaseStudy) -> None:
    shown = interface_of(case.combination("rush.fast.thrift"), detect=True)
    assert {one.name: one for one in shown.variables} == {
        "loc": ShownVariable("loc", 0, 0, ("here",)),
        "load": ShownVariable("load", 0, 4),
        "alarm": ShownVariable("alarm", 0, 1, boolean=True),
        "running": ShownVariable("running", 1, 4),
        "booting": ShownVariable("booting", 0, 1),
        "seen": ShownVariable("seen", 0, 1, ("never", "once")),
    }
    assert shown.detectors == ()


def test_a_task_that_follows_another_keeps_all_but_what_the_objective_watches(case: CaseStudy) -> None:
    system = simulated(case, reset="none")
    system.reset()
    while not system.values["seen"]:  # type: ignore[index]
        if system.step(KEEP).last:
            system.reset()
    shrunk(system)
    ended = dict(system.values or {})
    assert (ended["done"], ended["seen"], ended["alarm"]) == (1, 1, 1)
    system.reset()
    assert system.values == {**ended, "done": 0, "seen": 0}


def test_an_episode_begins_as_the_case_says(case: CaseStudy) -> None:
    system = simulated(case)
    first = system.reset().valuation.tolist()
    shrunk(system)
    assert system.reset().valuation.tolist() == first


def test_it_goes_on_under_another_combination_in_the_same_state(case: CaseStudy) -> None:
    system, other = simulated(case), case.combination("calm.slow.quality")
    system.reset()
    system.step(GROW)
    before = system.values
    assert system.fits(other)
    system.switch(other)
    assert system.values == before
    # -4 a missing server and -1 a running one, in place of -1 and -1
    assert before is not None
    assert system.step(KEEP).reward == -4 * max(before["load"] - 1, 0) - 1


def test_a_snapshot_has_the_values_of_all_variables(case: CaseStudy) -> None:
    one, other = simulated(case, reset="none"), simulated(case, reset="none")
    one.reset()
    one.step(GROW)
    other.restore(json.loads(json.dumps(one.snapshot())))
    assert other.values == one.values
    assert [one.step(KEEP).reward for _ in range(5)] == [other.step(KEEP).reward for _ in range(5)]


def test_a_change_of_meaning_cannot_be_gone_on_with(case: CaseStudy, tmp_path: Path) -> None:
    """With a load of 4 no state of a service that bears 3 at most is the same."""
    text = ENDING.replace("range: [0, 4]", "range: [0, 3]").replace("min(load + 1, 4)", "min(load + 1, 3)")
    (tmp_path / "small").mkdir()
    smaller = load_case(write_case(tmp_path / "small", text)).combination("rush.fast.thrift")
    system = simulated(case)
    system.reset()
    assert system.fits(smaller)
    while system.values["load"] < 4:  # type: ignore[index]
        system.step(KEEP)
    assert not system.fits(smaller)


def test_it_is_served_with_truth_values_and_managed_from_afar(case: CaseStudy) -> None:
    combination = case.combination("rush.fast.thrift")
    served = ServedSystem(simulated(case), interface_of(combination, detect=False))
    here = simulated(case)
    with running(server(served)) as url:
        schema = httpx.get(f"{url}/monitor_schema").json()["properties"]["valuation"]["properties"]
        assert schema["alarm"] == {"type": "boolean"}
        assert schema["seen"] == {"type": "integer", "minimum": 0, "maximum": 1, "names": ["never", "once"]}
        assert httpx.get(f"{url}/monitor").json()["valuation"]["alarm"] is False
        with open_served(url) as remote:
            assert remote.interface.variables == served.interface.variables
            here.reset()  # the served system began with an episode
            assert remote.reset().valuation.tolist() == here.reset().valuation.tolist()
            pairs = [(remote.step(GROW), here.step(GROW)), (remote.step(KEEP), here.step(KEEP))]
    for there, own in pairs:
        assert (there.valuation.tolist(), there.reward) == (own.valuation.tolist(), own.reward)


def test_nobody_returns_to_a_start_where_there_is_no_space(tmp_path: Path) -> None:
    placeless = ENDING.replace("space:\n  locations: {here: [0, 0]}\n  edges: []\n", "")
    case = load_case(write_case(tmp_path, placeless.replace("  start: here\n", "")))
    with pytest.raises(InputError, match="has no space in which to return to a start; reset it by `none` or"):
        simulated(case, reset="return_to_start")
    system = simulated(case, reset="none", detect=True)
    assert system.reset().detections == {}
    shrunk(system)
    system.reset()
    assert system.values is not None
    assert "loc" not in system.values


def test_the_way_back_to_a_single_location_is_no_step(case: CaseStudy) -> None:
    system = simulated(case, reset="return_to_start")
    system.reset()
    shrunk(system)
    system.reset()
    assert system.steps_back == 0


def test_no_such_reset(case: CaseStudy) -> None:
    with pytest.raises(InputError, match="no reset mode"):
        simulated(case, reset="never")
