from __future__ import annotations

import dataclasses
import json

import pytest

from merap.families.loading import load_case
from merap.mapek.records import EpisodeRow
from merap.mapek.scenario import Moment, Stage
from merap.mapek.scores import LoopReport, Reaction, reactions, summary
from tests.support.loop_examples import episode_row as row
from tests.support.paths import MODELS

SYSTEM = load_case(MODELS / "paper-grid" / "rq1-1.yaml").system("met")
STAGES = (
    Stage(Moment(0), (), SYSTEM),
    Stage(Moment(2), ("environment",), SYSTEM),
    Stage(Moment(6), ("objective",), SYSTEM),
)


def course(*expected: float, entered: float = -9.0, replans: int | None = None) -> list[EpisodeRow]:
    """Two good episodes, then those of the second stage, which begins in episode 2."""
    rows = [row(0, 0, 6.0), row(1, 0, 6.0)]
    for number, value in enumerate(expected):
        first = {"entered": entered} if number == 0 else {}
        rows.append(row(2 + number, 1, value, replans=int(number == replans), **first))
    return rows


def test_recovered_is_when_three_values_in_a_row_are_good() -> None:
    """After the second episode of the stage: values 5.7, 6, 6; each lost 2 until then."""
    found = reactions(course(-9.0, 5.7, 6.0, 6.0, replans=1), STAGES)
    assert found == (Reaction(2, ("environment",), replanned=3, episodes=2, steps=20, lost=4.0),)


def test_a_value_that_is_good_by_chance_is_none() -> None:
    found = reactions(course(6.0, -9.0, 5.69, 6.0, 6.0), STAGES)
    assert (found[0].episodes, found[0].lost) == (None, 10.0)
    assert reactions(course(6.0, -9.0, 5.7, 6.0, 6.0), STAGES)[0].episodes == 3


def test_a_change_that_does_no_harm_needs_no_reaction() -> None:
    found = reactions(course(6.0, 6.0, entered=5.8), STAGES)
    assert found == (Reaction(2, ("environment",), replanned=None, episodes=0, steps=0, lost=0.0),)


def test_a_reaction_ends_with_its_stage() -> None:
    """The next change comes before three good values: not recovered, though they follow."""
    rows = [*course(-9.0, 6.0), row(4, 2, 6.0, entered=6.0), row(5, 2, 6.0)]
    assert [reaction.episodes for reaction in reactions(rows, STAGES)] == [None, 0]


def test_a_stage_that_was_never_in_force_has_no_reaction() -> None:
    assert reactions([row(0, 0, 6.0)], STAGES) == ()


def test_the_summary_counts() -> None:
    rows = [
        row(0, 0, 6.0, earned=6.0),
        row(1, 0, 6.0, earned=2.0, unsafe=3, replans=1, updates=1, fallbacks=2, problems=4, completed=False),
    ]
    found = summary(
        rows, [Reaction(1, ("objective",), 1, 3, 30, 1.0), Reaction(1, (), None, None, None, 1.0)]
    )
    assert found == {
        "episodes": 2,
        "mean_return": 4.0,
        "mean_discounted_return": 2.0,
        "mean_optimum": 6.0,
        "mean_safe_optimum": None,
        "regret": 4.0,
        "completed": 1,
        "violations": 1,
        "unsafe_steps": 3,
        "adaptations": 1,
        "policy_updates": 1,
        "fallbacks": 2,
        "problems": 4,
        "faults": {},
        "changes": 2,
        "changes_recovered_from": 1,
        "mean_episodes_to_recover": 3.0,
    }
    assert summary(rows, [])["mean_episodes_to_recover"] is None


def test_a_report_is_json_and_keeps_the_clock_apart() -> None:
    rows = course(-9.0, 6.0, 6.0, 6.0)
    report = LoopReport(
        "small",
        "merap",
        "grid",
        0,
        tuple(rows),
        reactions(rows, STAGES),
        None,
        (0.5, 0.25, 1.0, 2.0, 4.0, 8.0),
    )
    content = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert content["times"]["seconds_to_recover"] == [pytest.approx(1.0 + 2.0)]
    assert EpisodeRow(**content["episodes"][2]) == rows[2]
    later = dataclasses.replace(report, seconds=(9.0,) * 6).as_dict()
    del content["times"], later["times"]
    assert json.loads(json.dumps(later)) == content


def test_a_shielded_loop_is_held_to_what_its_threshold_leaves() -> None:
    """4 of at most 4 within the threshold is as good as can be, though 6 is the free optimum."""
    shielded = [dataclasses.replace(one, safe_optimum=4.0, expected=4.0) for one in course(-9.0, -9.0, -9.0)]
    (found,) = reactions(shielded, STAGES)
    assert (found.episodes, found.lost) == (1, 0.0)
    assert summary(shielded, [found])["mean_safe_optimum"] == 4.0
    assert summary(shielded, [found])["mean_optimum"] == 6.0
