from __future__ import annotations

import numpy as np
import pytest

from merap.families.loading import load_case
from merap.mdp.index import index_of
from merap.mdp.model import Floats
from merap.strategies.evaluation import Run, reachable_range
from merap.strategies.fixed import FixedStrategy, optimal_policy
from merap.systems.simulated import SimulatedSystem
from scripts.bench.following import Lengths, followed, outside_of
from tests.support.paths import MODELS
from tests.support.placed import model_of

PAPER = MODELS / "paper-grid"
HORIZON = 18


@pytest.mark.parametrize(("number", "outside"), [(1, ""), (4, ""), (5, "O"), (6, "E"), (7, "C"), (8, "ECO")])
def test_what_lies_outside_the_base_is_as_the_paper_says(number: int, outside: str) -> None:
    # shared/paper, RQ1: cases 1 to 4 are covered, 5 to 8 are not, by goal, environment, capability and all.
    assert outside_of(load_case(PAPER / f"rq1-{number}.yaml")) == outside


def followed_policy(policy: Floats, lengths: Lengths) -> Run:
    system = load_case(PAPER / "rq1-1.yaml").system("met")
    model = model_of(system)
    of_system, of_strategy = np.random.default_rng(0).spawn(2)
    strategy = FixedStrategy(policy, index_of(model), of_strategy, "given")
    simulated = SimulatedSystem(system, HORIZON, of_system)
    return followed(0, simulated, strategy, model, reachable_range(model, HORIZON), HORIZON, lengths)


def optimal() -> Floats:
    return optimal_policy(model_of(load_case(PAPER / "rq1-1.yaml").system("met")), HORIZON)


def test_it_ends_when_it_is_good_for_good_but_has_the_least_episodes() -> None:
    # the best policy is within 5 percent in rows 0, 1 and 2
    assert [followed_policy(optimal(), Lengths(least, 60)).curve[-1].episodes for least in (1, 5)] == [2, 5]
    assert followed_policy(optimal(), Lengths(5, 60)).episodes_to_within_5_percent == 0


def test_it_ends_with_the_most_episodes_and_regret_is_of_the_first() -> None:
    # One action for ever: -0.5 in each of 18 steps, where 6 can be had.
    stubborn = np.zeros_like(optimal()[0])
    stubborn[:, 0] = 1.0
    run = followed_policy(stubborn, Lengths(4, 7))
    assert run.curve[-1].episodes == 7
    assert run.episodes_to_within_5_percent is None
    gap = run.first_episode_regret
    assert gap == pytest.approx(15)
    assert (run.cumulative_regret, run.sampled_regret) == pytest.approx((4 * gap, 4 * gap))
