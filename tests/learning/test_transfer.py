from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from merap.errors import InputError
from merap.learning.config import TrainingConfig
from merap.learning.episodes import rollout
from merap.learning.exact import expected_return
from merap.learning.gradient_step import behaviour, sampled_step
from merap.learning.meta import MetaPolicy, carried_over
from merap.learning.models import train_models
from merap.learning.policy import policy_table, stack_parameters
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp.model import TabularMDP
from merap.runs.checkpoint import read_policy
from merap.runs.train import tasks_of
from merap.strategies.adaptation import adapt
from tests.support.hand_made import grid_combination
from tests.support.learning_examples import ring_batch, seeded
from tests.support.placed import model_of
from tests.support.trained_runs import SMALL, trained

HORIZON = 12
DISCOUNT = 0.95


def grid_of(size: int, goal: tuple[int, int]) -> TabularMDP:
    return model_of(grid_combination(goal=goal, size=size))


def grids_of(size: int, *goals: tuple[int, int]) -> TaskBatch:
    return task_batch([grid_of(size, goal) for goal in goals], HORIZON, DISCOUNT)


def trained_on_six_by_six(observation: str, updates: int = 2) -> MetaPolicy:
    config = TrainingConfig(updates=updates, observation=observation)  # type: ignore[arg-type]
    goals = [(1, 3), (3, 1), (2, 2), (4, 1), (1, 4)]
    return train_models([grid_of(6, goal) for goal in goals], HORIZON, DISCOUNT, config)


def test_parameters_of_a_small_grid_run_and_adapt_on_a_larger_one() -> None:
    """The exact return on the 9 x 9 grid rises by adaptation, over goals the small grid had and had not.

    Over 20 seeds of the generator it rose by 3.9 on average, by 2.3 at least, with a standard
    deviation of 0.8: by chance it rises by less than 0.5 in about one of 10,000 seeds.
    """
    meta = trained_on_six_by_six("factored", updates=60)
    tasks = grids_of(9, (2, 2), (1, 3), (3, 1), (3, 2), (2, 3), (4, 2))
    carried = carried_over(meta, tasks)
    assert carried.network.num_states == 83
    generator = seeded(0)
    parameters = stack_parameters(carried.parameters, tasks.num_tasks)
    values = []
    for _ in range(6):
        with torch.no_grad():
            policy = policy_table(carried.network, parameters, tasks.enabled)
        values.append(expected_return(policy, tasks).mean().item())
        exploring = behaviour(carried.network, parameters, tasks.enabled, carried.rule)
        episodes = rollout(exploring, tasks, 35, generator)
        parameters = sampled_step(
            carried.network,
            parameters,
            carried.step_sizes,
            tasks.enabled,
            episodes,
            carried.rule,
            carried.variance,
        ).parameters
    assert values[-1] > values[0] + 0.5, values


def test_a_policy_that_knows_states_by_number_stays_on_models_of_its_size() -> None:
    meta = trained_on_six_by_six("one_hot")
    assert carried_over(meta, grids_of(6, (5, 5))) is meta
    with pytest.raises(InputError, match=r"observes 38 states one-hot, the models have 83; train with obser"):
        carried_over(meta, grids_of(9, (2, 2)))


def test_a_run_reads_back_what_its_policy_observes(tmp_path: Path) -> None:
    run = trained(tmp_path / "run", SMALL.model_copy(update={"observation": "factored"}))
    meta = read_policy(run, tasks_of(run))
    assert meta.network.features is not None
    assert len(meta.network.features) == 83
    assert meta.parameters["layer0.weight"].shape[0] == meta.network.features.shape[1]
    assert len(adapt(run, run.case.system("met"), steps=1).runs[0].curve) == 2


def test_other_variables_and_actions_are_refused_in_one_line() -> None:
    meta = trained_on_six_by_six("factored")
    ring = ring_batch(torch.float32)
    with pytest.raises(InputError, match=r"^the policy chooses among 5 actions, the models have 6$"):
        carried_over(meta, ring)
    grid = grids_of(6, (5, 5))
    assert grid.features is not None
    with pytest.raises(InputError, match=r"^the policy observes 30 features, the models have 29: "):
        carried_over(meta, replace(grid, features=grid.features[:, 1:]))
