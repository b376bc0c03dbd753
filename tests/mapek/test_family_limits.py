"""A loop on a family over which no belief is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.concerns.case_study import CaseStudy
from merap.errors import InputError
from merap.families.loading import load_case
from merap.mapek.family_limits import followable
from merap.mapek.messages import AdaptedPolicy, Monitored
from merap.mapek.plain_analyzer import PlainAnalyzer
from merap.mapek.scenario import Scenario, read_scenario
from tests.support.case_examples import write_case
from tests.support.paths import MODELS
from tests.support.process_cases import SERVICE


@pytest.fixture
def case(tmp_path: Path) -> CaseStudy:
    return load_case(write_case(tmp_path, SERVICE))


def scenario(folder: Path, *lines: str) -> Scenario:
    path = folder / "scenario.yaml"
    path.write_text("\n".join(("scenario: busy", "system: calm.fast.thrift", "episodes: 100", *lines, "")))
    return read_scenario(path)


def test_defaults_that_need_a_belief_are_left_out_aloud(case: CaseStudy, tmp_path: Path) -> None:
    found, notices = followable(scenario(tmp_path), case)
    assert (found.spec.strategy.name, found.spec.trigger.kind) == ("gradient", "none")
    assert notices == (
        "service: no belief is kept over this family so far, since load changes beside location and mode: "
        "adapting by gradient",
        "service: without a belief no change is noticed: the trigger is off",
    )


def test_what_is_followable_stays_as_it_is(case: CaseStudy, tmp_path: Path) -> None:
    plain = scenario(tmp_path, "strategy: {name: retrieval}", "trigger: {kind: none}")
    assert followable(plain, case)[1] == ()
    assert followable(plain, case)[0].spec == plain.spec
    spatial = scenario(tmp_path)
    assert followable(spatial, load_case(MODELS / "running-example")) == (spatial, ())


@pytest.mark.parametrize(
    ("line", "place"),
    [
        ("strategy: {name: belief}", "scenario.yaml:4: strategy.name"),
        ("trigger: {kind: change}", "scenario.yaml:4: trigger"),
        ("shield: {threshold: 0.1}", "scenario.yaml:4: shield"),
        ("learning: {extend: true}", "scenario.yaml:4: learning.extend"),
    ],
)
def test_what_needs_a_belief_is_refused_where_it_is_asked_for(
    case: CaseStudy, tmp_path: Path, line: str, place: str
) -> None:
    with pytest.raises(InputError) as found:
        followable(scenario(tmp_path, line), case)
    assert str(found.value).startswith(str(tmp_path / place.split(":", maxsplit=1)[0]))
    assert place in str(found.value)
    assert "this needs a belief, and no belief is kept over service so far" in str(found.value)


def monitored(step: int, state: int | None, seen: int | None) -> Monitored:
    return Monitored(0, step, (), np.ones(3, dtype=np.bool_), state, seen, (), (), last=False)


def test_the_plain_analyzer_says_where_the_system_was_last_seen() -> None:
    analyzer = PlainAnalyzer(4, 2)
    assert analyzer.analyse(monitored(0, None, None)).whereabouts.tolist() == [0.25] * 4
    assert analyzer.analyse(monitored(1, 2, 2)).whereabouts.tolist() == [0, 0, 1, 0]
    assert analyzer.analyse(monitored(2, None, 2)).whereabouts.tolist() == [0, 0, 1, 0]


def test_the_plain_analyzer_ends_an_adaptation_after_its_updates() -> None:
    analyzer = PlainAnalyzer(4, 2)
    policies = [AdaptedPolicy(number, np.zeros((4, 3)), ()) for number in range(3)]
    assert [analyzer.enough(policy) for policy in policies] == [False, False, True]
    assert not PlainAnalyzer(4, None).enough(policies[2])
    analyzer.settle(policies[2].table)
    found = analyzer.analyse(monitored(0, 1, 1))
    assert (found.phase, found.replan) == ("executing", False)
