from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from merap.errors import InputError
from merap.mapek.managers import MANAGERS, Manager, RandomStrategy, ReactiveStrategy, make_manager
from merap.mapek.scenario_schema import StrategySpec
from merap.mdp.planning import optimum, worst_value
from merap.runs.run_folder import RunFolder
from merap.strategies.evaluation import executed
from merap.strategies.registry import StrategyContext
from merap.systems.interface import Observation
from tests.support.grid_tasks import HORIZON, grid_model, grid_task
from tests.support.loop_examples import seen
from tests.support.placed import base_of
from tests.support.trained_runs import trained

STOP, UP, DOWN, LEFT, RIGHT = range(5)
ALL = np.ones(5, dtype=np.bool_)
DRAWS = 5000


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> StrategyContext:
    run: RunFolder = trained(tmp_path_factory.mktemp("runs") / "run")
    return StrategyContext(run, HORIZON, run.case.discount)


def manager(name: str, context: StrategyContext) -> Manager:
    return make_manager(name, StrategySpec(updates=7), context)


def test_who_replans_and_how_long_an_adaptation_is(context: StrategyContext) -> None:
    found = {name: manager(name, context) for name in MANAGERS}
    assert {name: one.replans for name, one in found.items() if one.replans} == {"merap": True}
    assert [found[name].updates for name in ("merap", "none", "static", "random", "reactive")] == [
        7, 0, 7, None, None,
    ]  # fmt: skip


@pytest.mark.parametrize("name", MANAGERS)
def test_every_manager_has_a_policy(name: str, context: StrategyContext) -> None:
    strategy = manager(name, context).make(np.random.default_rng(0))
    model = context.base.models[0]
    assert executed(model, strategy.policy()).shape[-2:] == (model.num_states, model.num_actions)
    assert strategy.explain()


def test_an_unknown_manager_is_refused(context: StrategyContext) -> None:
    with pytest.raises(InputError, match=r"no manager 'reactiv'; did you mean 'reactive'\?"):
        manager("reactiv", context)


def test_random_takes_each_allowed_action_as_often() -> None:
    """4 standard deviations of a binomial, three times: fails by luck once in 5,000."""
    allowed = np.array([True, False, True, False, True])
    strategy = RandomStrategy((82, 5), np.random.default_rng(0))
    counts = np.bincount([strategy.act(allowed) for _ in range(DRAWS)], minlength=5)
    assert counts[[1, 3]].tolist() == [0, 0]
    assert np.all(np.abs(counts[allowed] - DRAWS / 3) <= 4 * math.sqrt(DRAWS * 2 / 9))


def on_grid(row: int, col: int, reward: float) -> Observation:
    """As the hand-made models have it: without a mode."""
    observation = seen(row, col, reward)
    return replace(observation, valuation=observation.valuation[:2])


def reactive() -> ReactiveStrategy:
    models = [grid_model(grid_task((0, 2))), grid_model(grid_task((2, 0)))]
    return ReactiveStrategy(base_of(models, HORIZON, 1.0), HORIZON, np.random.default_rng(0))


def first_action(strategy: ReactiveStrategy) -> int:
    strategy.begin(on_grid(0, 0, 0.0))
    return strategy.act(ALL)


@pytest.mark.parametrize(("earned", "expected"), [(9.0, RIGHT), (0.0, RIGHT), (-0.5, DOWN), (-9.0, DOWN)])
def test_reactive_goes_on_to_the_next_model_when_an_episode_went_badly(earned: float, expected: int) -> None:
    """The best is 9 and the worst -9: it is content from 0 on."""
    model = grid_model(grid_task((0, 2)))
    assert (optimum(model, HORIZON), worst_value(model, HORIZON)) == (9, -9)
    strategy = reactive()
    assert first_action(strategy) == RIGHT
    strategy.observe(RIGHT, on_grid(0, 1, earned))
    strategy.update()
    assert first_action(strategy) == expected


def test_reactive_counts_what_was_earned_before_a_gap() -> None:
    strategy = reactive()
    assert first_action(strategy) == RIGHT
    strategy.observe(RIGHT, on_grid(0, 1, -9.0))
    strategy.begin(on_grid(0, 1, 0.0), 3, resumed=True)
    strategy.observe(RIGHT, on_grid(0, 2, 8.5))
    strategy.update()
    assert first_action(strategy) == DOWN


def test_reactive_tries_the_models_in_turn() -> None:
    strategy, found = reactive(), []
    for _ in range(4):
        found.append(first_action(strategy))
        strategy.observe(STOP, on_grid(0, 0, -9.0))
        strategy.update()
    assert found == [RIGHT, DOWN, RIGHT, DOWN]
