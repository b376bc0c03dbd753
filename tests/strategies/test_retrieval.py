"""Retrieval on cases made by hand: which one fits, and what is made of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from merap.mdp.index import index_of
from merap.mdp.model import TabularMDP
from merap.runs.train import batch_of
from merap.strategies.evaluation import evaluator, reachable_range
from merap.strategies.fixed import optimal_policy
from merap.strategies.retrieval import FitSettings, RetrievalStrategy
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from merap.systems.strategy import StateIndex
from tests.support.grid_tasks import DISCOUNT, HORIZON, block, grid_model, grid_task
from tests.support.placed import base_of
from tests.support.whole_adaptations import adapted

GOALS = block((3, 6), (3, 6))
RIGHT = np.arange(5) == 4


def retrieval(
    models: Sequence[TabularMDP], horizon: int, discount: float, settings: FitSettings | None = None
) -> RetrievalStrategy:
    base = base_of(models, horizon, discount)
    return RetrievalStrategy(base, batch_of(base), horizon, np.random.default_rng(0), settings)


@pytest.mark.parametrize("seed", range(3))
def test_a_covered_goal_is_found_by_elimination(seed: int) -> None:
    """Each episode tries one of sixteen goals: the right one after at most sixteen."""
    models = [grid_model(grid_task(goal)) for goal in GOALS]
    strategy = retrieval(models, HORIZON, DISCOUNT)
    met = grid_model(grid_task((5, 6)))
    run = adapted(
        seed,
        SimulatedSystem(met, HORIZON, np.random.default_rng(seed)),
        strategy,
        evaluator(met, HORIZON),
        reachable_range(met, HORIZON),
        max_episodes=18,
    )
    assert run.episodes_to_within_5_percent is not None
    assert run.episodes_to_within_5_percent <= 16
    assert strategy.explain()[0] == f"plays case{GOALS.index((5, 6))}, of 1 cases that fit best"
    np.testing.assert_array_equal(strategy.policy(), optimal_policy(met, HORIZON))


def observed(location: tuple[int, int], reward: float, *, ended: bool = False) -> Observation:
    enabled = np.full(5, not ended)
    return Observation(np.array(location), enabled, reward, 0.0 if ended else 1.0, truncated=False)


def test_the_fit_of_a_step_is_its_likelihood_in_each_case() -> None:
    """Slip 0, 0.1 and 0.5; a move that fails, one that works, and rewards a little off.

    Rewards range over 10.5, so a tenth is a standard deviation of 1.05; a case without slip has no
    explanation for a move that fails.
    """
    models = [grid_model(grid_task((4, 4)), slip) for slip in (0.0, 0.1, 0.5)]
    settings = FitSettings(reward_deviation=0.1, unexplained=-20.0)
    strategy = retrieval(models, HORIZON, DISCOUNT, settings)
    strategy.begin(observed((0, 0), 0.0))
    for target, reward in (((0, 0), -0.5), ((0, 1), 0.55)):
        assert strategy.act(RIGHT) == 4
        strategy.observe(4, observed(target, reward))
    strategy.update()
    off = -(1.05**2) / (2 * 1.05**2)
    expected = [-20 + off, np.log(0.1) + np.log(0.9) + off, 2 * np.log(0.5) + off]
    plays, following = strategy.explain()
    assert plays == "plays case2, of 1 cases that fit best"
    assert following == f"the next fits worse by {expected[2] - expected[1]:.3g} nats"


def test_one_odd_step_refutes_no_case_for_good() -> None:
    """Case 0 has the goal at (0, 1), case 1 at (0, 2)."""
    models = [grid_model(grid_task(goal)) for goal in ((0, 1), (0, 2))]
    strategy = retrieval(models, HORIZON, DISCOUNT)

    def stops_at_1(reward: float, *, ended: bool) -> None:
        strategy.begin(observed((0, 0), 0.0))
        strategy.observe(4, observed((0, 1), -0.5))
        strategy.observe(0, observed((0, 1), reward, ended=ended))
        strategy.update()

    stops_at_1(-0.5, ended=False)
    assert strategy.explain()[0] == "plays case1, of 1 cases that fit best"
    stops_at_1(10.0, ended=True)
    assert strategy.explain()[0].endswith("of 2 cases that fit best")
    stops_at_1(10.0, ended=True)
    assert strategy.explain()[0] == "plays case0, of 1 cases that fit best"


def test_a_state_that_a_case_can_not_reach_speaks_against_it() -> None:
    models = [grid_model(grid_task((4, 4), closed)) for closed in ([(0, 1)], [(1, 0)])]
    strategy = retrieval(models, HORIZON, DISCOUNT)
    for location in ((0, 0), (0, 1), (0, 1)):
        strategy.begin(observed(location, 0.0))
    strategy.update()
    assert strategy.explain() == (
        "plays case1, of 1 cases that fit best",
        "the next fits worse by 10 nats",  # once, however often it is seen
    )


def test_which_actions_are_enabled_speaks_for_a_case() -> None:
    """Two equal cases but for a mask, at a place where nothing was done."""
    models = [grid_model(grid_task((4, 4)))] * 2
    base = replace(base_of(models, HORIZON, DISCOUNT), names=("less", "more"))
    tasks = batch_of(base)
    enabled = tasks.enabled.clone()
    enabled[0, 0, 1] = False
    masked = replace(tasks, enabled=enabled)
    strategy = RetrievalStrategy(base, masked, HORIZON, np.random.default_rng(0))
    strategy.begin(observed((0, 0), 0.0))
    strategy.update()
    assert strategy.explain()[0] == "plays more, of 1 cases that fit best"


def test_after_a_gap_the_retrieved_policy_goes_on_at_the_time_that_it_is() -> None:
    """In the last step the goal, two steps away, is out of reach: any action costs the same."""
    model = grid_model(grid_task((0, 2)))
    strategy = retrieval([model], HORIZON, DISCOUNT)
    best = strategy.policy()
    number = StateIndex(index_of(model))(observed((0, 0), 0.0))
    assert (best[0, number] != best[HORIZON - 1, number]).any()
    for time in (0, HORIZON - 1):
        strategy.begin(observed((0, 0), 0.0), time, resumed=time > 0)
        assert strategy.act(np.ones(5, dtype=np.bool_)) == best[time, number].argmax()
