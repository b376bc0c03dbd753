from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.belief.actions import action_tables
from merap.belief.outside import Outside
from merap.belief.posterior import weights
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.case_study import load_declared_case
from merap.errors import InputError
from tests.support.belief_routes import STRIP, inferred, log_likelihood, trajectory
from tests.support.case_examples import GRAPH, replaced, write_case
from tests.support.paths import MODELS

RUNNING = (MODELS / "running-example" / "case.yaml").read_text(encoding="utf-8")
NOISE = 0.3


def kind(space: HypothesisSpace, name: str) -> int:
    return space.outcome_names.index(name)


def test_a_deterministic_case_has_none() -> None:
    space = hypothesis_space(load_declared_case(MODELS / "paper-grid" / "rq1-1.yaml"))
    assert space.outcome_names == ("as the base says", "slip 0.05", "slip 0.1", "slip 0.2", "slip 0.4")


def test_other_odds_weigh_what_a_whole_model_with_them_does(tmp_path: Path) -> None:
    # Second route: the case written anew. Odds of 3 to 1 times 3 are 9 to 1.
    (tmp_path / "other").mkdir()
    case = load_declared_case(write_case(tmp_path, STRIP))
    other = load_declared_case(write_case(tmp_path / "other", STRIP.replace("0.75", "0.9")))
    space = hypothesis_space(case, Outside(odds=(3.0,)), noise=NOISE)
    # Every known environment has one closed cell; b leaves r0c1 open, so that `up` is worth a try.
    actual = other.combination("b.full.right")
    seen = trajectory(actual, 30, NOISE, np.random.default_rng(0))
    dynamics, _ = weights(inferred(case, space, seen))
    found = np.log(dynamics[1, 0, kind(space, "odds of all outcomes times 3")]) - np.log(dynamics[1, 0, 0])
    prior = space.prior[1, 0, kind(space, "odds of all outcomes times 3")] - space.prior[1, 0, 0]
    expected = log_likelihood(actual, seen, NOISE, 0.0) - log_likelihood(
        case.combination("b.full.right"), seen, NOISE, 0.0
    )
    assert abs(expected) > 0.1
    assert found - prior == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        # Odds p / (1 - p) times 10, by hand: 0.85 -> 8.5/8.65, 0.98 -> 9.8/9.82;
        # 0.9 -> 9/9.1, 0.75 -> 7.5/7.75.
        ("pace", ("pace: 0.98", "pace: 0.85"), ("pace: 0.9979633401221996", "pace: 0.9826589595375723")),
        ("focus", ("focus: 0.9", "focus: 0.75"), ("focus: 0.989010989010989", "focus: 0.967741935483871")),
    ],
)
def test_a_parameter_takes_another_value(
    tmp_path: Path, name: str, old: tuple[str, str], new: tuple[str, str]
) -> None:
    space = hypothesis_space(load_declared_case(MODELS / "running-example"))
    text = RUNNING
    for before, after in zip(old, new, strict=True):
        text = text.replace(before, after)
    other = load_declared_case(write_case(tmp_path, text))
    expected = action_tables([[other.combine(0, 0, 0), other.combine(0, 1, 0)]])
    disturbed = int(space.disturbance[kind(space, f"odds of {name} times 10")])
    for mine, theirs in zip(space.actions, expected, strict=True):
        np.testing.assert_allclose(mine.prob[:, :, disturbed], theirs.prob[:, :, 0], atol=1e-12)


def test_every_disturbance_is_a_distribution_wherever_an_action_is_enabled() -> None:
    space = hypothesis_space(load_declared_case(MODELS / "running-example"))
    for table in space.actions:
        total = table.prob.sum(axis=-1)
        np.testing.assert_allclose(
            total, np.broadcast_to(table.enabled[np.newaxis, :, np.newaxis], total.shape)
        )


def test_worse_motors_than_any_in_the_base_are_noticed(tmp_path: Path) -> None:
    # The scanner's odds are 1 to 9 instead of 9 or 3 to 1: with 200 measurements the posterior odds against
    # any base capability are beyond e^100 but for a chance of less than e^-50.
    case = load_declared_case(MODELS / "running-example")
    other = load_declared_case(write_case(tmp_path, RUNNING.replace("focus: 0.9", "focus: 0.1")))
    seen = trajectory(other.combination("b_blocked.speed_low.g1"), 600, NOISE, np.random.default_rng(1))
    space = hypothesis_space(case, noise=NOISE)
    kinds = weights(inferred(case, space, seen))[0].sum(axis=(0, 1))
    assert kinds[0] < 1e-6
    assert kinds[[number for number, one in enumerate(space.outcome_names) if "focus" in one]].sum() > 0.99


def test_concerns_that_read_each_other_are_refused(tmp_path: Path) -> None:
    case = load_declared_case(write_case(tmp_path, replaced(GRAPH, "{value: -1}", "{value: -lamp}")))
    with pytest.raises(InputError, match="takes no case whose concerns read each other's parameters"):
        hypothesis_space(case)
