from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.concerns.lookup import declared
from merap.errors import InputError
from merap.mapek.scenario import Moment, Scenario, read_scenario
from merap.mapek.scenario_schema import scenario_schema
from tests.support.paths import MODELS

EXAMPLE = MODELS / "running-example"
SHIPPED = EXAMPLE / "three-changes.yaml"

MINIMAL = """\
scenario: small
system: met
episodes: 9
changes:
  - {at: {episode: 3}, environment: {blocked: [A, B]}}
  - {at: {episode: 5, step: 2}, objective: g1, capability: speed_low}
"""


@pytest.fixture(scope="module")
def case() -> DeclaredCase:
    return load_declared_case(EXAMPLE)


def written(folder: Path, text: str) -> Path:
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def scenario(folder: Path, text: str = MINIMAL) -> Scenario:
    return read_scenario(written(folder, text))


def refused(folder: Path, old: str, new: str, case: DeclaredCase | None = None) -> str:
    """The message about a scenario with one mistake, without the folder's name."""
    assert old in MINIMAL

    def use() -> None:
        read = scenario(folder, MINIMAL.replace(old, new, 1))
        if case is not None:
            read.action(case)
            read.stages(case)

    with pytest.raises(InputError) as error:
        use()
    return str(error.value).replace(f"{folder}/", "")


def test_stages_take_over_what_does_not_change(tmp_path: Path, case: DeclaredCase) -> None:
    stages = scenario(tmp_path).stages(case)
    assert [stage.begins for stage in stages] == [Moment(0), Moment(3), Moment(5, 2)]
    assert [stage.changed for stage in stages] == [(), ("environment",), ("capability", "objective")]
    met = case.system("met")
    assert stages[0].system.environment.parameters == met.environment.parameters
    assert stages[1].system.capability.name == "speed_high"
    assert stages[1].system.objective.name == "g3"
    blocked = declared(stages[2].system).environment.blocked
    assert [case.space.locations[p] for p in blocked.nonzero()[0]] == ["A", "B"]
    assert (stages[2].system.capability.name, stages[2].system.objective.name) == ("speed_low", "g1")


def test_a_parameter_that_a_change_does_not_name_keeps_its_value(tmp_path: Path, case: DeclaredCase) -> None:
    """Whether the stage before has it by values or by the name of a configuration."""
    text = MINIMAL.replace("capability: speed_low", "capability: {grip: 0.7}")
    assert text != MINIMAL
    stages = scenario(tmp_path, text).stages(case)
    before, after = (stage.system.capability.parameters for stage in stages[1:])
    assert set(after) == set(before)
    assert after == {**before, "grip": 0.7}


YARD = """\
case: yard
space:
  grid: {rows: 2, cols: 3, moves: {east: [0, 1], west: [0, -1], south: [1, 0]}}
  doors: {gate: {between: [[0, 0], [0, 1]], open: true}}
environment:
  parameters: {blocked: locations, blocked_edges: edges, locked: doors, wind: {probability: [0, 1]}}
  configurations:
    calm: {blocked: [[1, 1]], blocked_edges: [[[0, 1], [0, 2], east]], locked: [gate], wind: 0}
capability:
  actions: {east: {move: east, probability: 1 - wind}, west: {move: west}, wait: {}}
objective:
  parameters: {goal: location, worth: real}
  start: [0, 0]
  horizon: 5
  rewards: [{to: goal, value: worth}]
  configurations: {far: {goal: [0, 2], worth: 1}}
"""


def test_parameters_that_are_not_named_may_be_sets_and_cells(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text(YARD, encoding="utf-8")
    text = """\
scenario: storm
system: calm.default.far
episodes: 4
changes:
  - {at: {episode: 1}, environment: {wind: 0.5}}
  - {at: {episode: 2}, objective: {worth: 3}}
"""
    calm, windy, dear = (
        stage.system for stage in scenario(tmp_path, text).stages(load_declared_case(tmp_path))
    )
    assert windy.environment.parameters == {**calm.environment.parameters, "wind": 0.5}
    assert dear.environment.parameters == windy.environment.parameters
    assert dear.objective.parameters == {"goal": [0, 2], "worth": 3}


@pytest.mark.parametrize(
    "system", ["b_blocked.speed_low.g2", "{environment: b_blocked, capability: speed_low, objective: g2}"]
)
def test_a_system_is_a_name_or_its_configurations(tmp_path: Path, case: DeclaredCase, system: str) -> None:
    first = scenario(tmp_path, MINIMAL.replace("met", system)).stages(case)[0].system
    names = (first.environment.name, first.capability.name, first.objective.name)
    assert names == ("b_blocked", "speed_low", "g2")


def test_a_change_to_what_there_is_already_is_none(tmp_path: Path, case: DeclaredCase) -> None:
    text = MINIMAL.replace("environment: {blocked: [A, B]}", "objective: g3")
    assert scenario(tmp_path, text).stages(case)[1].changed == ()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("episodes: 9", "episodes: 0", "scenario.yaml:3: episodes: expected a number of at least 1, got 0"),
        (
            "episodes: 9",
            "epsodes: 9",
            "scenario.yaml:3: epsodes: unknown key 'epsodes'; did you mean 'episodes'?",
        ),
        (
            "episode: 3}",
            "episode: -1}",
            "scenario.yaml:5: changes[0].at.episode: expected a number of at least 0",
        ),
        ("system: met", "system: 3", "scenario.yaml:2: system: expected the name of a system, or a mapping"),
        (
            "episode: 5, step: 2",
            "episode: 3",
            "scenario.yaml:6: changes[1].at: a change must come after the one before it",
        ),
        (
            "episode: 5, step: 2",
            "episode: 9",
            "scenario.yaml:6: changes[1].at.episode: there are 9 episodes, the last is 8",
        ),
        (
            ", environment: {blocked: [A, B]}",
            "",
            "scenario.yaml:5: changes[0]: nothing changes; name at least one of environment, capability",
        ),
        ("scenario: small", "scenario: 'a b'", "scenario.yaml:1: scenario: illegal name 'a b' of a scenario"),
        ("episodes: 9", "episodes: 9\nnoise: {slip: 1.0}", "scenario.yaml:4: noise.slip: "),
        ("episodes: 9", "episodes: 9\nreset: never", "scenario.yaml:4: reset: expected 'episodes', "),
    ],
)
def test_what_the_schema_refuses(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert refused(tmp_path, old, new).startswith(message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("system: met", "system: mett", "scenario.yaml:2: system: running_example has no combination 'mett'"),
        (
            "objective: g1",
            "objective: g4",
            "scenario.yaml:6: changes[1].objective: unknown configuration 'g4' of objective",
        ),
        (
            "blocked: [A, B]",
            "blokked: [A]",
            "scenario.yaml:5: changes[0].environment.blokked: unknown parameter 'blokked'; did you mean",
        ),
        ("blocked: [A, B]", "blocked: [S]", "scenario.yaml:5: changes[0]: the start location S is blocked"),
        ("blocked: [A, B]", "blocked: [X]", "scenario.yaml:5: changes[0].environment.blocked: "),
        ("step: 2", "step: 40", "scenario.yaml:6: changes[1].at.step: an episode has 40 steps, got 40"),
        (
            "episodes: 9",
            "episodes: 9\ndeadline: {fallback: stopp}",
            "scenario.yaml:4: deadline.fallback: unknown action 'stopp'; did you mean 'stop'?",
        ),
    ],
)
def test_what_does_not_fit_the_case(
    tmp_path: Path, case: DeclaredCase, old: str, new: str, message: str
) -> None:
    assert refused(tmp_path, old, new, case).startswith(message)


def test_the_fallback_is_an_action_of_the_case(tmp_path: Path, case: DeclaredCase) -> None:
    read = scenario(tmp_path, f"{MINIMAL}deadline: {{fallback: stop}}\n")
    assert read.action(case) == case.actions.index("stop")
    assert scenario(tmp_path).action(case) is None


def test_settings_hold_the_defaults(tmp_path: Path) -> None:
    settings = scenario(tmp_path).settings()
    assert settings["strategy"]["name"] == "belief"
    assert settings["changes"][1]["at"] == {"episode": 5, "step": 2}


def data(path: Path) -> Any:
    return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))


def test_the_shipped_scenario_changes_each_concern_once(case: DeclaredCase) -> None:
    stages = read_scenario(SHIPPED).stages(case)
    assert [stage.changed for stage in stages] == [(), ("environment",), ("capability",), ("objective",)]


def test_the_json_schema_agrees(tmp_path: Path) -> None:
    """Second route: an editor checks with a JSON Schema validator, merap with pydantic."""
    validator = jsonschema.Draft202012Validator(scenario_schema())
    validator.check_schema(scenario_schema())
    assert [error.message for error in validator.iter_errors(data(SHIPPED))] == []
    for wrong in ("episodes: 0", "epsodes: 9"):
        assert not validator.is_valid(data(written(tmp_path, MINIMAL.replace("episodes: 9", wrong))))
