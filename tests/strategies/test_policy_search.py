"""Exact policy search, against what breadth-first search and backward induction know."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from merap.families.loading import load_case
from merap.learning.exact import expected_return as exact_return
from merap.learning.policy import Parameters, PolicyNetwork, policy_table, stack_parameters
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Floats
from merap.mdp.planning import backward_induction
from merap.strategies.policy_search import SearchSettings, joint_parameters, separate_parameters
from tests.support.grid_tasks import DISCOUNT, HORIZON, grid_model, grid_task
from tests.support.learning_examples import RING_DISCOUNT, RING_HORIZON, ring_models
from tests.support.paths import MODELS
from tests.support.placed import models_of

NETWORK = PolicyNetwork(82, 5, (16, 16))
# The second is around a wall, the third at the far end of what 18 steps reach.
TASKS = [grid_task((2, 2)), grid_task((2, 2), [(1, 0), (1, 1), (1, 2)]), grid_task((8, 8))]
GRID_MODELS = [grid_model(task) for task in TASKS]
BATCH = task_batch(GRID_MODELS, HORIZON, DISCOUNT)
SEED_SETTINGS = SearchSettings(seed=3)


def tables(parameters: Parameters, tasks: TaskBatch, network: PolicyNetwork) -> Floats:
    """float64 [N, S, A + 1]."""
    with torch.no_grad():
        acting = policy_table(network, parameters, tasks.enabled).double().numpy()
    ending = ~tasks.enabled.any(dim=-1, keepdim=True).numpy()
    return np.concatenate([acting, ending], axis=-1)


@pytest.mark.parametrize("seed", range(3))
def test_a_policy_for_one_task_is_good_there(seed: int) -> None:
    """The optimum is known by search; local optima (through the goal, -0.5 (d + 1)) are far below."""
    found = tables(separate_parameters(NETWORK, BATCH, SearchSettings(seed=seed)), BATCH, NETWORK)
    values = [
        expected_return(model, policy, HORIZON) for model, policy in zip(GRID_MODELS, found, strict=True)
    ]
    assert values == pytest.approx([task.optimum for task in TASKS], abs=0.05)


def test_what_a_task_gives_does_not_depend_on_the_others() -> None:
    together = separate_parameters(NETWORK, BATCH, SEED_SETTINGS)
    alone = separate_parameters(NETWORK, BATCH[1:2], SEED_SETTINGS)
    ours = tables({name: value[1:2] for name, value in together.items()}, BATCH[1:2], NETWORK)
    # the same but for the order of additions, which 200 steps of Adam in float32 spread
    np.testing.assert_allclose(ours, tables(alone, BATCH[1:2], NETWORK), atol=0.01)


def test_the_joint_policy_of_equal_tasks_is_the_best_policy() -> None:
    model = ring_models()[0]
    tasks = task_batch([model, model], RING_HORIZON, RING_DISCOUNT)
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, (16,))
    parameters = joint_parameters(network, tasks, SEED_SETTINGS)
    policy = tables(stack_parameters(parameters, 1), tasks[:1], network)[0]
    # A stationary policy can be worse than the best by time; here it is not by much.
    best = backward_induction(model, RING_HORIZON, RING_DISCOUNT).value
    assert expected_return(model, policy, RING_HORIZON, RING_DISCOUNT) == pytest.approx(best, rel=0.02)


@pytest.mark.slow
def test_the_joint_policy_is_better_on_average_than_a_policy_for_one() -> None:
    """Goals one and two steps to the right: the joint policy stops at the first, for a time."""
    models = [grid_model(grid_task(goal)) for goal in ((0, 1), (0, 2))]
    tasks = task_batch(models, HORIZON, DISCOUNT)

    def mean(parameters: Parameters) -> float:
        policies = tables(parameters, tasks, NETWORK)
        pairs = zip(models, policies, strict=True)
        return float(np.mean([expected_return(model, policy, HORIZON, DISCOUNT) for model, policy in pairs]))

    joint = mean(stack_parameters(joint_parameters(NETWORK, tasks, SEED_SETTINGS), 2))
    separate = separate_parameters(NETWORK, tasks, SEED_SETTINGS)
    for own in range(2):
        one = {name: value[own].expand_as(value) for name, value in separate.items()}
        assert joint > mean(one) + 0.5


@pytest.mark.slow
def test_the_joint_policy_for_many_obstacles_is_about_as_good_as_the_best_for_one() -> None:
    """A policy for one is one for all, too: -1.66 on RQ1-2; joint -1.80, with much entropy alone -6.0."""
    case = load_case(MODELS / "paper-grid" / "rq1-2.yaml")
    models = models_of([case.combination_at(index) for index in range(0, case.size, 1000)])
    tasks = task_batch(models, HORIZON, DISCOUNT)
    network = PolicyNetwork(tasks.num_states, tasks.num_actions, NETWORK.hidden, NETWORK.activation)

    def mean(parameters: Parameters) -> float:
        stacked = stack_parameters(parameters, tasks.num_tasks)
        with torch.no_grad():
            return float(exact_return(policy_table(network, stacked, tasks.enabled), tasks).mean())

    separate = separate_parameters(network, tasks, SEED_SETTINGS)
    single = [mean({name: value[own] for name, value in separate.items()}) for own in range(len(models))]
    assert mean(joint_parameters(network, tasks, SEED_SETTINGS)) >= max(single) - 0.3


@pytest.mark.slow
def test_some_tasks_at_a_time_are_enough() -> None:
    few = SearchSettings(tasks_per_update=2)
    whole = joint_parameters(NETWORK, BATCH, SearchSettings())
    drawn = joint_parameters(NETWORK, BATCH, few)
    again = joint_parameters(NETWORK, BATCH, few)
    assert all(torch.equal(drawn[name], again[name]) for name in drawn)
    means = [
        np.mean(
            [
                expected_return(model, policy, HORIZON, DISCOUNT)
                for model, policy in zip(
                    GRID_MODELS, tables(stack_parameters(parameters, 3), BATCH, NETWORK), strict=True
                )
            ]
        )
        for parameters in (whole, drawn)
    ]
    assert means[1] == pytest.approx(means[0], abs=0.5)
