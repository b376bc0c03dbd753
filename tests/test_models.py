"""Learning without a case: a base of random FrozenLake maps from Gymnasium."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.envs.toy_text.frozen_lake import generate_random_map

from merap.errors import ModelError
from merap.learning.config import TrainingConfig
from merap.learning.exact import exact_problem, expected_return
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy
from merap.learning.models import train_models
from merap.learning.policy import policy_table, stack_parameters
from merap.learning.rollout import rollout, sampler
from merap.learning.tasks import task_batch
from merap.mdp.gymnasium_import import import_gymnasium
from merap.mdp.model import Floats, TabularMDP
from merap.online.managed.gymnasium import GymnasiumSystem
from merap.online.running import adaptation, evaluator
from merap.online.strategies.gradient import GradientStrategy
from tests.learning_examples import seeded
from tests.mdp_examples import jump_grid

HORIZON = 30
DISCOUNT = 0.95
TRAINED_ON = range(48)
MET = range(1000, 1032)
STEPS = 8


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
    """float64 [32] each, the exact return before and after some steps of 35 episodes."""
    meta, generator = lakes().meta, seeded(seed)
    tasks = task_batch([lake(seed) for seed in MET], HORIZON, discount=1.0)
    parameters, problem, simulated = (
        stack_parameters(meta.parameters, tasks.num_tasks),
        exact_problem(tasks),
        sampler(tasks),
    )
    values = []
    for _ in range(STEPS + 1):
        with torch.no_grad():
            policy = policy_table(meta.network, parameters, tasks.enabled)
        values.append(expected_return(policy, problem).double().numpy())
        exploring = behaviour(meta.network, parameters, tasks.enabled, meta.rule)
        episodes = rollout(exploring, simulated, 35, generator)
        parameters = sampled_step(
            meta.network, parameters, meta.step_sizes, tasks.enabled, episodes, meta.rule, meta.variance
        ).parameters
    return values[0], values[-1]


def test_adaptation_through_reset_and_step() -> None:
    """On Gymnasium's own environment of a map on which the meta policy gets across now and then."""
    env = gymnasium.make(
        "FrozenLake-v1",
        desc=generate_random_map(8, seed=1008),
        is_slippery=False,
        max_episode_steps=HORIZON,
    )
    model = import_gymnasium(env)
    strategy = GradientStrategy(lakes().meta, model.valuations, 35, np.random.default_rng(1))
    with GymnasiumSystem(env, seed=0) as system:
        rows = adaptation(system, strategy, evaluator(model, HORIZON), max_episodes=35 * 5)
        curve = [row.expected_return for row in rows]
    assert len(curve) == 6
    assert curve[-1] > curve[0] + 0.2, curve


def test_models_of_different_states_are_refused() -> None:
    with pytest.raises(ModelError, match="model 1 has"):
        train_models([lake(0), jump_grid()], HORIZON, DISCOUNT)
    with pytest.raises(ModelError, match="no model to learn from"):
        train_models([], HORIZON, DISCOUNT)


def test_the_example_runs() -> None:
    script = Path(__file__).parents[1] / "scripts" / "frozen_lake.py"
    command = [sys.executable, str(script), "--updates", "2", "--steps", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout.splitlines()[0] == "the best policy reaches the goal with probability 1.00"
    assert len(done.stdout.splitlines()) == 3
