"""Task batches: the models' own numbers, padded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from merap.errors import ModelError
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.threads import one_thread
from merap.mdp.model import TabularMDP
from tests.support.grid_tasks import COMPLETED, END, SIZE, grid_model, grid_task
from tests.support.learning_examples import RING_HORIZON, grid_models, ring_models

MODELS = [
    pytest.param(lambda: grid_models(0.0), id="deterministic"),
    pytest.param(lambda: grid_models(0.2), id="slipping"),
    pytest.param(ring_models, id="ring"),
]


def _batch(models: list[TabularMDP]) -> TaskBatch:
    return task_batch(models, RING_HORIZON, 0.9, torch.float64)


@pytest.mark.parametrize("models", MODELS)
def test_transitions_and_rewards_are_the_models(models: Callable[[], list[TabularMDP]]) -> None:
    made = models()
    tasks = _batch(made)
    shape = (tasks.num_states, tasks.num_actions, tasks.num_states)
    for n, model in enumerate(made):
        acting = model.choice_action != model.num_actions - 1
        choice = np.flatnonzero(acting)
        place = (model.choice_state[choice], model.choice_action[choice])
        expected = np.zeros(shape)
        expected[place] = model.transitions.toarray()[choice]
        arrives = torch.zeros(shape, dtype=torch.float64)
        arrives.scatter_add_(2, tasks.next_state[n], tasks.prob[n])
        np.testing.assert_array_equal(arrives.numpy(), expected)
        rewards = np.zeros(shape[:2])
        rewards[place] = model.choice_reward[choice]
        np.testing.assert_allclose(tasks.expected_reward[n].numpy(), rewards, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(tasks.enabled[n].numpy(), model.enabled[:, :-1])
        np.testing.assert_array_equal(tasks.initial[n].numpy(), model.initial)


@pytest.mark.parametrize("models", MODELS)
def test_only_the_completed_state_ends_an_episode(models: Callable[[], list[TabularMDP]]) -> None:
    tasks = _batch(models())
    last = tasks.num_states - 1
    real = tasks.prob > 0
    assert torch.equal(tasks.continuation[real] == 0, tasks.next_state[real] == last)
    assert not tasks.enabled[:, last].any()
    assert torch.equal(tasks.survival, torch.where(tasks.next_state == last, 0.0, tasks.prob))


@pytest.mark.parametrize("models", MODELS)
def test_padding_stays_in_its_state_for_nothing(models: Callable[[], list[TabularMDP]]) -> None:
    tasks = _batch(models())
    own = torch.arange(tasks.num_states)[:, None, None].expand(tasks.next_state.shape)
    padding = tasks.prob == 0
    assert padding.any()
    assert torch.equal(tasks.next_state[padding], own[padding])
    assert torch.all(tasks.reward[padding] == 0)
    torch.testing.assert_close(tasks.prob.sum(dim=-1), tasks.enabled.double(), rtol=0, atol=1e-12)


def test_a_branch_keeps_its_own_reward() -> None:
    # `measure` earns 0.3 where it succeeds, with 0.9, and else costs 1; location A is 1, mode scanning 1
    tasks = _batch(ring_models())
    state, measure = 1 * 3 + 1, 4
    drawn = dict(
        zip(tasks.prob[0, state, measure].tolist(), tasks.reward[0, state, measure].tolist(), strict=True)
    )
    assert drawn == {0.9: 0.3, 0.1: -1.0, 0.0: 0.0}
    assert tasks.expected_reward[0, state, measure].item() == pytest.approx(0.9 * 0.3 - 0.1)


def test_a_model_without_rewards_of_branches_has_those_of_choices() -> None:
    model = ring_models()[0]
    plain = _batch([replace(model, branch_reward=None)])
    choice = int(np.flatnonzero((model.choice_state == 4) & (model.choice_action == 4))[0])
    assert plain.reward[0, 4, 4, :2].tolist() == [model.choice_reward[choice]] * 2
    torch.testing.assert_close(plain.expected_reward, _batch([model]).expected_reward, rtol=1e-12, atol=1e-12)


def test_the_papers_grid_by_hand() -> None:
    # the paper's README: 82 states, the wall holds, any action in the goal ends, `stop` there earns 10
    tasks = _batch([grid_model(grid_task((0, 1)))])
    assert tasks.next_state.shape == (1, 82, 5, 1)
    assert tasks.next_state[0, 0, :, 0].tolist() == [0, 0, SIZE, 0, 1]
    assert tasks.next_state[0, 1, :, 0].tolist() == [COMPLETED] * 5
    assert tasks.expected_reward[0, 1].tolist() == [10.0, -0.5, -0.5, -0.5, -0.5]
    assert tasks.survival[0, 1].sum() == 0
    assert (tasks.horizon, tasks.discount) == (RING_HORIZON, 0.9)


@pytest.mark.parametrize("index", [slice(1, 3), [2, 0], torch.tensor([2, 0, 2])])
def test_chosen_tasks_are_those_of_a_batch_of_their_models(index: slice | list[int] | torch.Tensor) -> None:
    models = ring_models()
    chosen = _batch(models)[index]
    places = list(range(3))[index] if isinstance(index, slice) else [int(place) for place in index]
    alone = _batch([models[place] for place in places])
    # the same K: all have `go` with three outcomes
    for name in ("next_state", "prob", "reward", "continuation", "enabled", "initial"):
        assert torch.equal(getattr(chosen, name), getattr(alone, name)), name
    assert (chosen.num_tasks, chosen.horizon, chosen.discount) == (len(places), RING_HORIZON, 0.9)


def test_single_precision_is_the_default() -> None:
    tasks = task_batch(ring_models(), 3, 0.9)
    assert tasks.dtype == torch.float32
    assert {tasks.reward.dtype, tasks.continuation.dtype, tasks.initial.dtype} == {torch.float32}


def test_no_model_is_refused() -> None:
    with pytest.raises(ModelError, match=r"^there is no model to learn from$"):
        task_batch([], 3, 0.9)


def test_a_model_of_another_index_is_refused() -> None:
    grid, ring = grid_models(0.0)[0], ring_models()[0]
    with pytest.raises(ModelError, match=r"^model 1 has actions \('stop', 'go', .*not those of the case"):
        task_batch([grid, ring], 3, 0.9)
    swapped = grid.valuations.copy()
    swapped[[0, 1]] = swapped[[1, 0]]
    with pytest.raises(
        ModelError, match=r"^model 1 has other states than model 0; models must be canonical$"
    ):
        task_batch([grid, replace(grid, valuations=swapped)], 3, 0.9)
    with pytest.raises(ModelError, match=r"^model 0 has no label 'done'$"):
        task_batch([replace(grid, labels={})], 3, 0.9)


def test_a_model_without_end_is_refused() -> None:
    grid = grid_models(0.0)[0]
    names = list(grid.action_names)
    names[END] = "rest"
    with pytest.raises(ModelError, match=r"^model 0 has actions .*'rest'"):
        task_batch([replace(grid, action_names=tuple(names))], 3, 0.9)


def test_one_thread_is_for_a_while() -> None:
    def divide() -> None:
        with one_thread():
            inside.append(torch.get_num_threads())
            raise ZeroDivisionError

    inside: list[int] = []
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with pytest.raises(ZeroDivisionError):
            divide()
        assert (inside, torch.get_num_threads()) == ([1], 2)
    finally:
        torch.set_num_threads(before)
