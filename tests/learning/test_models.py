"""Learning without a case: a base of random FrozenLake maps from Gymnasium."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from functools import cache

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.envs.toy_text.frozen_lake import generate_random_map

from merap.errors import ModelError
from merap.learning.config import TrainingConfig
from merap.learning.episodes import rollout
from merap.learning.exact import expected_return
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy
from merap.learning.models import train_models
from merap.learning.policy import policy_table, stack_parameters
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp.gymnasium_import import import_gymnasium
from merap.mdp.index import index_of
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import optimum
from merap.strategies.evaluation import evaluator
from merap.strategies.gradient import GradientStrategy
from merap.strategies.protocol import adaptation_rows
from merap.systems.gymnasium import GymnasiumSystem
from tests.support.learning_examples import seeded
from tests.support.mdp_examples import jump_grid
from tests.support.paths import ROOT

HORIZON = 30
DISCOUNT = 0.95
TRAINED_ON = range(48)
MET = range(1000, 1032)
STEPS = 8
SLIPPERY_HORIZON = 100


@dataclass(frozen=True, eq=False)
class Lakes:
    meta: MetaPolicy
    adapted_returns: list[float]


def lake(seed: int) -> TabularMDP:
    return import_gymnasium("FrozenLake-v1", desc=generate_random_map(8, seed=seed), is_slippery=False)


@cache
def lakes() -> Lakes:
    returns: list[float] = []
    meta = train_models(
        [lake(seed) for seed in TRAINED_ON],
        HORIZON,
        DISCOUNT,
        TrainingConfig(updates=80, seed=0),
        on_update=lambda metrics: returns.append(metrics.adapted_return),
    )
    return Lakes(meta, returns)


def test_training_on_random_lakes_makes_adaptation_better() -> None:
    """An untrained policy adapts to none of them: hardly an episode gets across, 14 steps, by chance."""
    returns = lakes().adapted_returns
    assert np.mean(returns[:5]) < 0.05
    assert np.mean(returns[-10:]) > np.mean(returns[:5]) + 0.1


def test_adaptation_to_lakes_that_were_not_trained_on() -> None:
    """The share of episodes that get across rises; a paired t-test over 32 maps, 3 adaptations each.

    The statistic of other training seeds was 4.7 to 5.3; without an effect it would be above 3.4 for
    one of 1000 choices of maps (31 degrees of freedom).
    """
    rises = np.mean([after - before for before, after in map(before_and_after, range(3))], axis=0)
    statistic = rises.mean() / (rises.std(ddof=1) / np.sqrt(len(rises)))
    assert statistic > 3.4


def before_and_after(seed: int) -> tuple[Floats, Floats]:
    """float64 [32] each, the exact return on dry lakes before and after some steps of 35 episodes."""
    tasks = task_batch([lake(seed) for seed in MET], HORIZON, discount=1.0)
    values = curves(lakes().meta, tasks, seed)
    return values[0], values[-1]


def curves(meta: MetaPolicy, tasks: TaskBatch, seed: int) -> Floats:
    """float64 [steps + 1, N], exact returns before and after each step of 35 episodes."""
    generator = seeded(seed)
    parameters = stack_parameters(meta.parameters, tasks.num_tasks)
    values = []
    for _ in range(STEPS + 1):
        with torch.no_grad():
            policy = policy_table(meta.network, parameters, tasks.enabled)
        values.append(expected_return(policy, tasks).double().numpy())
        exploring = behaviour(meta.network, parameters, tasks.enabled, meta.rule)
        episodes = rollout(exploring, tasks, 35, generator)
        parameters = sampled_step(
            meta.network, parameters, meta.step_sizes, tasks.enabled, episodes, meta.rule, meta.variance
        ).parameters
    return np.array(values)


def slippery_lake(seed: int) -> TabularMDP:
    """Of Gymnasium's default size; two of three moves go astray."""
    return import_gymnasium("FrozenLake-v1", desc=generate_random_map(4, seed=seed))


@pytest.mark.parametrize("seed", range(3))
def test_adaptation_to_slippery_lakes_that_were_not_trained_on(seed: int) -> None:
    """The share of episodes that get across rises, over 32 maps.

    Over 12 other training seeds the paired t statistic was 6.2 to 8.5 and the mean rise 0.17 to
    0.40; without an effect the statistic would be above 3.4 for one of 1000 choices of maps.
    """
    config = TrainingConfig(seed=seed, updates=120, gae_lambda=0.5, exploration=0.02)
    meta = train_models([slippery_lake(number) for number in range(128)], SLIPPERY_HORIZON, 0.99, config)
    met = [slippery_lake(number) for number in MET]
    returns = curves(meta, task_batch(met, SLIPPERY_HORIZON, discount=1.0), seed)
    rises = returns[-1] - returns[0]
    assert rises.mean() / (rises.std(ddof=1) / np.sqrt(len(rises))) > 3.4
    assert rises.mean() > 0.1
    assert (returns <= [optimum(model, SLIPPERY_HORIZON) + 1e-5 for model in met]).all()


def test_adaptation_through_reset_and_step() -> None:
    """On Gymnasium's own environment of a map on which the meta policy gets across now and then."""
    env = gymnasium.make(
        "FrozenLake-v1",
        desc=generate_random_map(8, seed=1008),
        is_slippery=False,
        max_episode_steps=HORIZON,
    )
    model = import_gymnasium(env)
    strategy = GradientStrategy(lakes().meta, index_of(model), 35, np.random.default_rng(1))
    with GymnasiumSystem(env, seed=0) as system:
        rows = adaptation_rows(system, strategy, evaluator(model, HORIZON), max_episodes=35 * 5)
        curve = [row.expected_return for row in rows]
    assert len(curve) == 6
    assert curve[-1] > curve[0] + 0.2, curve


def test_models_of_different_states_are_refused() -> None:
    with pytest.raises(ModelError, match="model 1 has"):
        train_models([lake(0), jump_grid()], HORIZON, DISCOUNT)
    with pytest.raises(ModelError, match="no model to learn from"):
        train_models([], HORIZON, DISCOUNT)


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize("options", [[], ["--slippery", "--size", "4"]])
def test_the_example_runs(options: list[str]) -> None:
    script = ROOT / "scripts" / "frozen_lake.py"
    command = [sys.executable, str(script), "--updates", "2", "--steps", "1", "--maps", "1", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    lines = done.stdout.splitlines()
    assert lines[0].startswith("the best policy reaches the goal with probability ")
    assert [line.partition(":")[0] for line in lines[1:]] == ["after   0 episodes", "after  35 episodes"]
