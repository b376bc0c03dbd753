"""The trigger of a scenario file."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import pytest

from merap.errors import InputError
from merap.mapek.components import make_components, make_trigger
from merap.mapek.scenario import read_scenario
from merap.mapek.scenario_schema import scenario_schema
from merap.runs.run_folder import RunFolder
from merap.trigger.change import ChangeTrigger
from merap.trigger.settings import ChangeSettings, TriggerSpec, WindowSettings
from merap.trigger.trigger import Trigger
from merap.trigger.window import WindowTrigger
from tests.support.loop_runs import MOVED
from tests.support.trained_runs import trained
from tests.support.trigger_examples import reading


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


def read(folder: Path, trigger: str) -> TriggerSpec:
    path = folder / "scenario.yaml"
    path.write_text(f"scenario: small\nsystem: met\nepisodes: 9\ntrigger: {trigger}\n", encoding="utf-8")
    return read_scenario(path).spec.trigger


def test_what_is_given_counts_and_the_rest_is_default(tmp_path: Path) -> None:
    given = read(tmp_path, "{settings: {noise: 0.5, odds: [2, 20]}}")
    assert given.settings == ChangeSettings(noise=0.5, odds=(2.0, 20.0))
    given = read(tmp_path, "{kind: window, settings: {threshold: -1, steps: 18}}")
    assert given.settings == WindowSettings(threshold=-1.0, steps=18)
    assert read(tmp_path, "{kind: none}").settings is None
    assert read(tmp_path, "{kind: change}").settings == ChangeSettings()


def test_each_kind_makes_its_trigger() -> None:
    assert isinstance(make_trigger(ChangeSettings(), 0.9), ChangeTrigger)
    assert isinstance(make_trigger(WindowSettings(threshold=3), 0.9), WindowTrigger)
    assert make_trigger(None, 0.9) is None


def statistic(trigger: Trigger | None, rewards: list[float]) -> float:
    assert trigger is not None
    for reward in rewards:
        trigger.observe(reading(reward))
    alarm = trigger.episode_over()
    assert alarm is not None
    return alarm.statistic


@pytest.mark.parametrize(("discount", "expected"), [(None, 2.0 + 0.9 * 3.0), (0.5, 2.0 + 0.5 * 3.0)])
def test_a_window_is_discounted_as_the_case_is_unless_it_says_otherwise(
    discount: float | None, expected: float
) -> None:
    trigger = make_trigger(WindowSettings(threshold=100.0, discount=discount), 0.9)
    assert statistic(trigger, [2.0, 3.0]) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("trigger", "message"),
    [
        ("{kind: windw}", "trigger.kind: there is no trigger 'windw'; did you mean 'window'?"),
        ("{kind: [change]}", "trigger.kind: there is no trigger ['change']; known: change, window, none"),
        ("{knd: window}", "trigger.knd: unknown key 'knd'; did you mean 'kind'?"),
        ("{kind: window}", "trigger: a window needs settings with a threshold"),
        ("{kind: window, settings: {}}", "trigger.settings: key 'threshold' is missing"),
        (
            "{kind: window, settings: {threshold: 1, discount: 0}}",
            "trigger.settings.discount: expected a number above 0.0, got 0",
        ),
        (
            "{settings: {cooldwn: 3}}",
            "trigger.settings.cooldwn: unknown key 'cooldwn'; did you mean 'cooldown'?",
        ),
        ("{settings: {noise: 0}}", "trigger.settings.noise: expected a number above 0.0, got 0"),
        ("{settings: {odds: [0.5]}}", "trigger.settings.odds[0]: expected a number of at least 1.0, got 0.5"),
        ("{settings: {odds: []}}", "trigger.settings.odds: expected at least 1 entries, got []"),
        ("{settings: {release: 1}}", "trigger.settings.release: expected a number below 1.0, got 1"),
        ("{kind: none, settings: {noise: 1}}", "trigger.settings: unknown key 'settings'; known: kind"),
        ("3", "trigger: expected a mapping with kind and settings, got 3"),
    ],
)
def test_what_is_not_allowed_is_named_with_its_place(tmp_path: Path, trigger: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, trigger)
    assert str(error.value).startswith(f"{tmp_path}/scenario.yaml:4: {message}")


@pytest.mark.parametrize(
    ("trigger", "sound"),
    [
        ({}, True),
        ({"settings": {"cooldown": 3}}, True),
        ({"settings": {"cooldwn": 3}}, False),
        ({"kind": "window"}, False),
        ({"kind": "window", "settings": {"threshold": 3}}, True),
        ({"kind": "none"}, True),
        ({"kind": "none", "settings": {}}, False),
    ],
)
def test_editors_are_told_the_settings(trigger: object, sound: bool) -> None:
    """Second route: a JSON Schema validator."""
    validator = jsonschema.Draft202012Validator(scenario_schema())
    content = {"scenario": "small", "system": "met", "episodes": 9, "trigger": trigger}
    assert validator.is_valid(content) is sound


@pytest.mark.parametrize(
    ("strategy", "message"),
    [
        ("{name: beleif}", "strategy.name: there is no strategy 'beleif'; did you mean 'belief'?"),
        ("{name: oracle}", "strategy.name: 'oracle' needs the true model, which no loop is told"),
        ("{name: 'pretrained:all'}", "strategy.name: the base has no combination 'all'"),
        ("{name: gradient}", "strategy: a policy update of 'gradient' takes 35 episodes, but the scenario"),
        (
            "{name: ope, episodes_per_step: 11}",
            "strategy.episodes_per_step: a policy update of 'ope' takes 11 episodes, but the scenario has",
        ),
    ],
)
def test_a_strategy_that_is_none_for_the_loop_is_named_with_its_place(
    run: RunFolder, tmp_path: Path, strategy: str, message: str
) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(MOVED.replace("strategy: {updates: 3}", f"strategy: {strategy}"), encoding="utf-8")
    with pytest.raises(InputError) as error:
        make_components(run, read_scenario(path), "merap")
    assert str(error.value).startswith(f"{path}:6: {message}")
