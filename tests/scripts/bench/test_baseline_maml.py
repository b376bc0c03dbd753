"""The learner that the bench compares with must be right, or beating it means nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from merap.learning.policy import PolicyNetwork, policy_table
from merap.learning.threads import one_thread
from merap.mdp.evaluation import expected_return
from scripts.bench.baseline_episodes import Settings, World, initial_policy, make_world
from scripts.bench.baseline_maml import baseline_update
from tests.support.grid_tasks import HORIZON
from tests.support.learning_examples import grid_models, seeded, with_end

SETTINGS = Settings(tasks=2, episodes=40)


@pytest.fixture
def world() -> Iterator[World]:
    with one_thread():
        yield make_world(grid_models(slip=0.0), [HORIZON, HORIZON], SETTINGS.episodes)


def test_an_update_moves_the_policy_and_says_what_it_took(world: World) -> None:
    theta = initial_policy(world, seeded(0))
    moved, times, _ = baseline_update(world, theta, SETTINGS, seeded(1))
    assert any(not torch.equal(moved[name], theta[name]) for name in theta)
    assert set(times.seconds) == {"sampling", "inner step", "outer step"}
    # at most both samplings in full; a goal two steps away ends some episodes early
    assert 0 < times.steps < 2 * 2 * SETTINGS.episodes * HORIZON


def test_a_seed_determines_an_update(world: World) -> None:
    theta = initial_policy(world, seeded(0))
    first, second = (baseline_update(world, theta, SETTINGS, seeded(1))[0] for _ in range(2))
    assert all(torch.equal(first[name], second[name]) for name in theta)


@pytest.mark.slow
def test_it_learns(world: World) -> None:
    """The exact mean return over both tasks of the meta policy rises; without learning it would not."""
    theta, generator = initial_policy(world, seeded(0)), seeded(1)
    before = _meta_return(world, theta)
    for _ in range(20):
        theta, _, adapted = baseline_update(world, theta, SETTINGS, generator)
    assert _meta_return(world, theta) > before + 0.5
    assert adapted > before + 0.5


def _meta_return(world: World, theta: dict[str, torch.Tensor]) -> float:
    network = PolicyNetwork(world.num_states, world.num_actions)
    models = grid_models(slip=0.0)
    enabled = torch.from_numpy(models[0].enabled[:, :-1])
    with torch.no_grad():
        table = policy_table(network, theta, enabled)
    return float(np.mean([expected_return(model, with_end(table, model), HORIZON) for model in models]))
