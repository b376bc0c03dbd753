"""Task batches: the models' own numbers, branch by branch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from merap.errors import ModelError
from merap.learning.tasks import TaskBatch, task_batch
from merap.mdp.model import Ints, TabularMDP
from merap.mdp.reserved_names import END_ACTION
from tests.support.grid_tasks import COMPLETED, END, SIZE, grid_model, grid_task
from tests.support.learning_examples import RING_HORIZON, dense, grid_models, ring_models

MODELS = [
    pytest.param(lambda: grid_models(0.0), id="deterministic"),
    pytest.param(lambda: grid_models(0.2), id="slipping"),
    pytest.param(ring_models, id="ring"),
]

# Location 1 and mode 1 of three modes, behind two completed states.
OF_A_SCANNING = 2 + 1 * 3 + 1


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
        np.testing.assert_array_equal(dense(tasks, tasks.branch_prob)[n].numpy(), expected)
        rewards = np.zeros(shape[:2])
        rewards[place] = model.choice_reward[choice]
        np.testing.assert_allclose(tasks.expected_reward[n].numpy(), rewards, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(tasks.enabled[n].numpy(), model.enabled[:, :-1])
        np.testing.assert_array_equal(tasks.initial[n].numpy(), model.initial)


@pytest.mark.parametrize("models", MODELS)
def test_only_completed_states_end_an_episode(models: Callable[[], list[TabularMDP]]) -> None:
    tasks = _batch(models())
    completed = models()[0].labels["done"].copy()
    ends = torch.from_numpy(completed)[tasks.branch_target.long()]
    assert torch.equal(tasks.branch_continuation == 0, ends)
    assert ends.any()
    assert not tasks.enabled[:, completed].any()
    assert torch.equal(tasks.weight, torch.where(ends, 0.0, 0.9 * tasks.branch_prob))


@pytest.mark.parametrize("models", MODELS)
def test_an_action_has_branches_where_it_is_enabled(models: Callable[[], list[TabularMDP]]) -> None:
    made = models()
    tasks = _batch(made)
    counts = tasks.choice_to_branch.diff(dim=1).view(tasks.enabled.shape)
    assert torch.equal(counts > 0, tasks.enabled)
    assert tasks.branch_prob.min() > 0
    torch.testing.assert_close(
        dense(tasks, tasks.branch_prob).sum(dim=-1), tasks.enabled.double(), rtol=0, atol=1e-12
    )
    # nothing is padded
    acting = sum(
        int((model.choice_action[model.branch_choice] != model.num_actions - 1).sum()) for model in made
    )
    assert len(tasks.branch_prob) == acting


def test_a_branch_keeps_its_own_reward() -> None:
    # `measure` earns 0.3 where it succeeds, with 0.9, and else costs 1; location A is 1, mode scanning 1
    tasks = _batch(ring_models())
    state, measure = OF_A_SCANNING, 4
    mine = _branches_of(tasks, 0, state, measure)
    drawn = dict(zip(tasks.branch_prob[mine].tolist(), tasks.branch_reward[mine].tolist(), strict=True))
    assert drawn == {0.9: 0.3, 0.1: -1.0}
    assert tasks.expected_reward[0, state, measure].item() == pytest.approx(0.9 * 0.3 - 0.1)


def test_a_model_without_rewards_of_branches_has_those_of_choices() -> None:
    model = ring_models()[0]
    plain = _batch([replace(model, branch_reward=None)])
    choice = int(np.flatnonzero((model.choice_state == OF_A_SCANNING) & (model.choice_action == 4))[0])
    assert (
        plain.branch_reward[_branches_of(plain, 0, OF_A_SCANNING, 4)].tolist()
        == [model.choice_reward[choice]] * 2
    )
    torch.testing.assert_close(plain.expected_reward, _batch([model]).expected_reward, rtol=1e-12, atol=1e-12)


def test_the_papers_grid_by_hand() -> None:
    # the paper's README: 82 states, the wall holds, any action in the goal ends, `stop` there earns 10
    tasks = _batch([grid_model(grid_task((0, 1)))])
    assert tasks.enabled.shape == (1, 82, 5)
    assert len(tasks.branch_target) == 81 * 5
    assert tasks.branch_target[:5].tolist() == [0, 0, SIZE, 0, 1]
    assert tasks.branch_target[5:10].tolist() == [COMPLETED] * 5
    assert tasks.expected_reward[0, 1].tolist() == [10.0, -0.5, -0.5, -0.5, -0.5]
    assert tasks.weight[5:10].sum() == 0
    assert (tasks.horizon.tolist(), tasks.discount) == ([RING_HORIZON], 0.9)


@pytest.mark.parametrize("index", [slice(1, 3), [2, 0], torch.tensor([2, 0, 2])])
def test_chosen_tasks_are_those_of_a_batch_of_their_models(index: slice | list[int] | torch.Tensor) -> None:
    models = ring_models()
    everything = _batch(models)
    chosen = everything[index]
    places = list(range(3))[index] if isinstance(index, slice) else [int(place) for place in index]
    alone = _batch([models[place] for place in places])
    for name in ("enabled", "initial", "horizon", "expected_reward", "earliest"):
        assert torch.equal(getattr(chosen, name), getattr(alone, name)), name
    for name in ("branch_prob", "branch_reward", "branch_continuation"):
        assert torch.equal(dense(chosen, getattr(chosen, name)), dense(alone, getattr(alone, name))), name
    assert (chosen.num_tasks, chosen.discount) == (len(places), 0.9)
    # the branches themselves are not copied
    assert chosen.branch_prob.data_ptr() == everything.branch_prob.data_ptr()


def test_single_precision_is_the_default() -> None:
    tasks = task_batch(ring_models(), 3, 0.9)
    assert tasks.dtype == torch.float32
    assert {tasks.branch_reward.dtype, tasks.branch_continuation.dtype, tasks.initial.dtype} == {
        torch.float32
    }


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
        ModelError, match=r"^model 1 has other states than model 0; models must be on one index$"
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


@pytest.mark.parametrize("models", MODELS)
def test_the_earliest_times_are_those_of_breadth_first_search(models: Callable[[], list[TabularMDP]]) -> None:
    tasks = _batch(models())
    leads = (dense(tasks, tasks.branch_prob * tasks.branch_continuation) > 0).any(dim=2)
    reached = tasks.initial > 0
    expected = torch.where(reached, 0, RING_HORIZON)
    for time in range(1, RING_HORIZON):
        reached = reached | (reached.unsqueeze(2) & leads).any(dim=1)
        expected = torch.where(reached, expected.clamp_max(time), expected)
    assert torch.equal(tasks.earliest.long(), expected)
    assert (tasks.earliest == RING_HORIZON).any()


def test_horizons_may_differ() -> None:
    tasks = task_batch(ring_models(), [3, 12, 1], 0.9)
    assert tasks.horizon.tolist() == [3, 12, 1]
    assert tasks.longest_horizon == 12
    assert tasks[[2, 0]].longest_horizon == 3


def test_branches_may_come_in_any_order_of_choices() -> None:
    """A model whose choices of a state are not in the order of the actions, as engines may write them."""
    model = ring_models()[0]
    tasks = _batch([model])
    mirrored = replace(
        model, action_names=(*model.action_names[-2::-1], END_ACTION), choice_action=_mirrored(model)
    )
    turned = dense(_batch([mirrored]), _batch([mirrored]).branch_prob)
    assert torch.equal(turned.flip(2), dense(tasks, tasks.branch_prob))


def _mirrored(model: TabularMDP) -> Ints:
    last = model.num_actions - 1
    return np.where(model.choice_action == last, last, last - 1 - model.choice_action)


def _branches_of(tasks: TaskBatch, task: int, state: int, action: int) -> slice:
    choice = state * tasks.num_actions + action
    return slice(*tasks.choice_to_branch[task, choice : choice + 2].tolist())
