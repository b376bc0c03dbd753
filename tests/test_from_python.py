"""The library as a user calls it: what may be written for an argument, and one clear error for the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import merap
from merap.concerns.lookup import declared_case
from merap.families import render_case
from tests.support.paths import MODELS
from tests.support.trained_runs import ONE_OF_THREE, SMALL, contents, what_was_learned

# Seen without types, as by a user who has no type checker.
face: Any = import_module("merap")
SETTINGS: dict[str, Any] = {"updates": 5, "hidden": [4], "episodes": 5}
MEMBER = "open.no_entry_r3c4.middle"
SCENARIO = "scenario: short\nsystem: met\nepisodes: 3\n"


@dataclass(frozen=True)
class Trained:
    case: merap.CaseStudy
    run: merap.RunFolder
    scenario: Path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    folder = tmp_path_factory.mktemp("made")
    (folder / "scenario.yaml").write_text(SCENARIO)
    case = merap.load_case(str(ONE_OF_THREE))
    return Trained(case, merap.train(case, str(folder / "run"), SETTINGS), folder / "scenario.yaml")


def refused(call: Callable[[], Any]) -> str:
    with pytest.raises(merap.MerapError) as caught:
        call()
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_training_takes_paths_and_settings_in_any_form(made: Trained, tmp_path: Path) -> None:
    for number, (case, config, more) in enumerate(
        [
            (made.case, SMALL, {}),
            (str(ONE_OF_THREE), SETTINGS, {}),
            (ONE_OF_THREE, None, SETTINGS),
            (made.case, {"updates": 9}, SETTINGS),
        ]
    ):
        run = face.train(case, str(tmp_path / str(number)), config, **more)
        assert what_was_learned(run.path) == what_was_learned(made.run.path)
    later = merap.train(made.case, str(tmp_path / "later"), source=str(made.run.path), updates=1)
    assert later.config.hidden == (4,)  # the settings of the source hold where none are given


def test_a_run_is_read_by_its_path(made: Trained) -> None:
    for path in (made.run.path, str(made.run.path)):
        assert merap.read_run(path).names == made.run.names


@pytest.mark.parametrize("seeds", [3, np.int64(3), [3], (3,), range(3, 4), np.array([3]), "3", "3:4"])
def test_adaptation_takes_seeds_in_any_form(made: Trained, seeds: Any) -> None:
    found = merap.adapt(str(made.run.path), "met", steps=1, seeds=seeds)
    assert [one.seed for one in found.runs] == [3]
    assert found.strategy == "belief"  # unless told otherwise


def test_adaptation_takes_systems_by_name_and_as_combinations(made: Trained) -> None:
    by_name = merap.adapt(made.run, MEMBER, steps=1)
    found = merap.adapt(made.run, made.case.combination(MEMBER), steps=1)
    assert by_name.as_dict() == found.as_dict()


def test_numbers_may_be_of_numpy(made: Trained) -> None:
    conditions = face.Conditions(reward_noise=np.float64(0.5), slip=np.float32(0.1))
    found = merap.adapt(made.run, "met", steps=1, conditions=conditions)
    assert found.as_dict()["slip"] == float(np.float32(0.1))
    assert repr(face.ShieldSettings(np.float32(0.5))) == repr(merap.ShieldSettings(0.5))
    with pytest.raises(merap.MerapError, match="no objective says what is unsafe"):
        face.adapt(made.run, "met", shield=np.float32(0.5))
    one = made.case.combination_at(0)
    assert list(face.verify(one, timeout=np.int64(60))) == list(merap.verify(one))


def test_verify_takes_a_case_a_path_one_or_several(made: Trained) -> None:
    of_case = list(merap.verify(made.case))
    assert [verdict.combination for verdict in of_case][::3] == list(made.run.names)
    assert list(merap.verify(str(ONE_OF_THREE))) == list(merap.verify(ONE_OF_THREE)) == of_case
    one = made.case.combination_at(0)
    assert list(merap.verify(one)) == list(merap.verify([one])) == of_case[:3]


def test_the_loop_takes_paths_and_the_place_of_a_knowledge_base(made: Trained, tmp_path: Path) -> None:
    place = str(tmp_path / "k.db")
    report = merap.run_loop(str(made.run.path), str(made.scenario), knowledge=place)
    again = merap.run_loop(made.run, merap.read_scenario(made.scenario), knowledge=Path(place), resume=True)
    assert len(report.rows) == len(again.rows) == 3


def test_other_functions_take_paths_too(made: Trained, tmp_path: Path) -> None:
    assert merap.build_base(str(ONE_OF_THREE), max_tasks=2).covered == 3
    assert render_case(made.case, made.case.combinations(), str(tmp_path / "models")) == 3
    assert len(contents(tmp_path / "models")) == 4
    generator = np.random.default_rng(5)
    names = [one.name for one in made.case.sample(2, generator)]
    assert [one.name for one in made.case.sample(2, 5)] == names


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda made: face.load_case(5), "case: expected a path, got 5"),
        (lambda made: face.load_case(None), "case: expected a path, got nothing"),
        (lambda made: face.read_run(5), "run: expected a path, got 5"),
        (lambda made: face.read_run("nowhere"), "nowhere: is not a run folder of merap"),
        (lambda made: face.read_scenario(5), "scenario: expected a path, got 5"),
        (lambda made: face.train(5, "run"), "case: expected a case or the path of one, got 5"),
        (lambda made: face.train(made.case, None), "path: expected a path, got nothing"),
        (lambda made: face.train(made.case, "run", 5), "config: expected a mapping of names to value"),
        (lambda made: face.train(made.case, "run", {1: 2}), "config: expected a mapping of names to values"),
        (lambda made: face.train(made.case, "run", {"foo": 1}), "foo: unknown setting"),
        (lambda made: face.train(made.case, "run", udpates=1), "udpates: unknown setting; did you mean"),
        (lambda made: face.train(made.case, "run", source=5), "run: expected a path, got 5"),
        (lambda made: face.resume(made.run.path, updates="x"), "updates: expected a whole number, got 'x'"),
        (lambda made: face.TrainingConfig(foo=1), "foo: unknown setting; known: "),
        (lambda made: face.TrainingConfig(updates="x"), "updates: expected a whole number, got 'x'"),
        (lambda made: face.TrainingConfig(hidden=5), "hidden: expected a list, got 5"),
        (lambda made: face.TrainingConfig(step_size=float("nan")), "step_size: expected a"),
        (lambda made: face.build_base(made.case, max_tasks=0), "max_tasks: expected a whole number of"),
        (lambda made: face.build_base(made.case, seed=-1), "seed: expected a whole number of at least 0"),
        (lambda made: face.render(made.case), "combination: expected a combination"),
        (lambda made: face.render("met"), "combination: expected a combination"),
        (lambda made: list(face.verify(5)), "expected a case or combinations, got 5"),
        (lambda made: list(face.verify(made.case, ["reach"])), "only: expected a name, got ['reach']"),
        (lambda made: list(face.verify([MEMBER])), f"case.combination(NAME), got '{MEMBER}'"),
        (lambda made: made.case.combination(5), "combination: expected a name, got 5"),
        (lambda made: made.case.system(5), "system: expected a name, got 5"),
        (lambda made: made.case.combination_at(3), "expected an index from 0 to 2, got 3"),
        (lambda made: made.case.combination_at(-1), "expected an index from 0 to 2, got -1"),
        (lambda made: face.Conditions(slip="much"), "slip: expected a number, got 'much'"),
        (lambda made: face.ShieldSettings(threshold=2), "threshold of a shield must be in [0, 1], it is 2"),
        (lambda made: face.ShieldSettings(threshold="low"), "shield: expected a number, got 'low'"),
        (lambda made: face.ShieldSettings(0.1, "low"), "hazard_prior: expected a number, got 'low'"),
        (lambda made: face.Conditions(reward_noise=10**400), "is too large for a number"),
        (lambda made: list(face.verify(made.case, timeout=10**400)), "is too large for a number"),
        (lambda made: list(face.verify(made.case, timeout="5")), "timeout: expected a number, got '5'"),
        (lambda made: list(face.verify(made.case, timeout=True)), "timeout: expected a number, got true"),
        (lambda made: face.run_loop(made.run, made.scenario, lines="log"), "lines: expected JsonLines"),
        (lambda made: face.run_loop(made.run, 5), "scenario: expected a path, got 5"),
        (lambda made: face.run_loop(5, made.scenario), "run: expected a path, got 5"),
        (lambda made: face.run_loop(made.run, made.scenario, manager=5), "manager: expected a name, got 5"),
        (lambda made: face.run_loop(made.run, made.scenario, knowledge=5), "expected KnowledgeBase"),
    ],
)  # fmt: skip
def test_what_can_not_be_meant_is_one_error(
    made: Trained,
    call: Callable[[Trained], Any],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert complaint in refused(lambda: call(made))
    assert contents(tmp_path) == {}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"system": 5}, "system: expected a combination, or the name of one or of an online system, got 5"),
        ({"system": "mett"}, "has no system 'mett'; did you mean 'met'?"),
        ({"run": None}, "run: expected a path, got nothing"),
        ({"strategy": "gradeint"}, "there is no strategy 'gradeint'; did you mean 'gradient'?"),
        ({"strategy": 5}, "strategy: expected a name, got 5"),
        ({"steps": 0}, "steps: expected a whole number of at least 1, got 0"),
        ({"steps": "3"}, "steps: expected a whole number of at least 1, got '3'"),
        ({"steps": True}, "steps: expected a whole number of at least 1, got true"),
        ({"episodes_per_step": 1.5}, "episodes_per_step: expected a whole number of at least 1, got 1.5"),
        ({"max_episodes": -1}, "max_episodes: expected a whole number of at least 1, got -1"),
        ({"seeds": -1}, "seeds: expected a whole number of at least 0, got -1"),
        ({"seeds": 1.5}, "seeds: expected a whole number of at least 0, got 1.5"),
        ({"seeds": None}, "seeds: expected a whole number of at least 0, got nothing"),
        ({"seeds": [1, "a"]}, "seeds: expected a whole number of at least 0, got 'a'"),
        ({"seeds": []}, "seeds: there is no seed in []"),
        ({"seeds": range(-1, 3)}, "seeds must be from 0 to "),
        ({"seeds": 2**63}, "seeds must be from 0 to "),
        ({"seeds": "a:b"}, "seeds: expected a:b with whole numbers or one seed, got 'a:b'"),
        ({"conditions": 5}, "conditions: expected Conditions, got 5"),
        ({"shield": "low"}, "shield: expected ShieldSettings, got 'low'"),
        ({"shield": 10**400}, "shield: 1000000"),
        ({"shield": 0.1}, "no objective says what is unsafe"),
    ],
)
def test_adaptation_refuses_what_can_not_be_meant(
    made: Trained, arguments: dict[str, Any], complaint: str
) -> None:
    assert complaint in refused(lambda: face.adapt(**{"run": made.run, "system": "met", **arguments}))


def test_a_system_of_another_case_is_refused(made: Trained) -> None:
    other = merap.load_case(MODELS / "running-example").system("met")
    assert refused(lambda: merap.adapt(made.run, other)) == "system: met is of another case than paper_rq1_3"


def test_a_goal_out_of_reach_is_warned_of(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text(ONE_OF_THREE.read_text().replace("horizon: 18", "horizon: 7"))
    with pytest.warns(merap.MerapWarning, match=r"no task can reach its goal within 7 steps; cut off: "):
        run = merap.train(tmp_path / "case.yaml", tmp_path / "run", SETTINGS)
    with pytest.warns(merap.MerapWarning) as caught:
        merap.adapt(run, "met", steps=1)
    assert [str(one.message)[:39] for one in caught] == [
        "no task can reach its goal within 7 ste",
        "met can't reach its goal within 7 steps",
    ]
    assert {one.filename for one in caught} == {__file__}


def test_everything_public_has_a_short_repr(made: Trained) -> None:
    adaptation = merap.adapt(made.run, "met", steps=1)
    combination = made.case.combination_at(0)
    base = merap.build_base(made.case)
    things = [
        made.case, declared_case(made.case).space, made.case.supports, made.run, made.run.config, combination,
        combination.environment, combination.capability, combination.objective, base, base.models[0],
        next(iter(merap.verify(combination))), adaptation, adaptation.runs[0], adaptation.conditions,
        merap.read_scenario(made.scenario), merap.run_loop(made.run, made.scenario), merap.TrainingConfig(),
        merap.ShieldSettings(0.1),
    ]  # fmt: skip
    for thing in things:
        assert len(repr(thing)) <= 320, repr(thing)[:400]
        assert "\n" not in repr(thing)
    assert repr(merap.TrainingConfig()) == "TrainingConfig()"
    assert (
        repr(merap.TrainingConfig(estimator="sampled", seed=3))
        == "TrainingConfig(estimator='sampled', seed=3)"
    )
