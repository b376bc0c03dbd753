"""Tasks of one case side by side, as lists of branches on one index.

Nothing is padded: memory is linear in the branches.

Axes: N tasks, S states, A actions without `end`, B branches of all tasks, F features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from merap.errors import ModelError
from merap.families.observation import VariableKind, model_kinds, observation_features
from merap.mdp.model import Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION


class TaskBranches(NamedTuple):
    """The branches of a batch, one after the other: int64 [M] all."""

    number: Tensor  # where a branch stands in the arrays of the batch
    choice: Tensor  # (n S + s) A + a of the choice that it belongs to
    source: Tensor  # n S + s
    target: Tensor  # n S + s' of the state that it leads to


@dataclass(frozen=True, eq=False)
class TaskBatch:
    """Several MDPs side by side.

    The end of an episode is a continuation of 0. Completed states have no enabled action,
    nor has a state that is unreachable in a task. Batches of some of the tasks share the branches' arrays.

    Attributes:
        choice_to_branch: int64 [N, S A + 1], the branches of action a in state s are those from
            [n, s A + a] to [n, s A + a + 1]; those of a task stand together.
        branch_target: int32 [B], index into S.
        branch_prob: float [B], sums to 1 over the branches of an enabled action.
        branch_reward: float [B], r(s, a, s').
        branch_continuation: float [B], probability that the step does not complete the task.
        enabled: bool [N, S, A].
        initial: float [N, S], a distribution.
        horizon: int64 [N], steps of an episode.
        discount: in [0, 1].
        features: float [S, F], the factored observation; None if it isn't known.
    """

    choice_to_branch: Tensor
    branch_target: Tensor
    branch_prob: Tensor
    branch_reward: Tensor
    branch_continuation: Tensor
    enabled: Tensor
    initial: Tensor
    horizon: Tensor
    discount: float
    features: Tensor | None = None

    def __post_init__(self) -> None:
        num_tasks, num_states, num_actions = self.enabled.shape
        assert self.choice_to_branch.shape == (num_tasks, num_states * num_actions + 1), num_states
        for array in (self.branch_prob, self.branch_reward, self.branch_continuation):
            assert array.shape == self.branch_target.shape, array.shape
        assert (self.initial.shape, self.horizon.shape) == ((num_tasks, num_states), (num_tasks,))
        assert self.features is None or len(self.features) == num_states, self.features.shape

    @property
    def num_tasks(self) -> int:
        """N."""
        return self.enabled.shape[0]

    @property
    def num_states(self) -> int:
        """S."""
        return self.enabled.shape[1]

    @property
    def num_actions(self) -> int:
        """A."""
        return self.enabled.shape[2]

    @property
    def dtype(self) -> torch.dtype:
        """Of probabilities and rewards."""
        return self.branch_prob.dtype

    @cached_property
    def longest_horizon(self) -> int:
        """Steps of the longest episode."""
        return int(self.horizon.max())

    @cached_property
    def weight(self) -> Tensor:
        """float [B], discounted probability to go on along a branch."""
        return self.discount * self.branch_prob * self.branch_continuation

    @cached_property
    def expected_reward(self) -> Tensor:
        """float [N, S, A], r(s, a)."""
        terms = (self.branch_prob * self.branch_reward)[self.branches.number]
        sums = torch.zeros(self.enabled.numel(), dtype=self.dtype, device=terms.device)
        return sums.index_add_(0, self.branches.choice, terms).view(self.enabled.shape)

    @cached_property
    def branches(self) -> TaskBranches:
        """Every branch of these tasks, with what it belongs to."""
        counts = self.choice_to_branch.diff(dim=1).flatten()
        choice = torch.repeat_interleave(counts)
        within = torch.arange(len(choice), device=choice.device) - (counts.cumsum(0) - counts)[choice]
        number = self.choice_to_branch[:, :-1].flatten()[choice] + within
        source = choice // self.num_actions
        task = source // self.num_states
        return TaskBranches(number, choice, source, task * self.num_states + self.branch_target[number])

    @cached_property
    def earliest(self) -> Tensor:
        """int32 [N, S], how many steps it takes to get to a state at least; the horizon if they don't do."""
        first, target = self.choice_to_branch[:, :: self.num_actions].numpy(), self.branch_target.numpy()
        going = (self.branch_prob * self.branch_continuation > 0).numpy()
        earliest = np.full(self.initial.shape, self.longest_horizon, dtype=np.int32)
        task, state = np.nonzero(self.initial.numpy() > 0)
        for time in range(self.longest_horizon):
            earliest[task, state] = time
            begin, end = first[task, state], first[task, state + 1]
            branch, origin = ranges_between(begin, end)
            branch, origin = branch[going[branch]], origin[going[branch]]
            entered = np.stack([task[origin], target[branch]])
            entered = entered[:, earliest[entered[0], entered[1]] == self.longest_horizon]
            if not entered.size:
                break
            task, state = np.unique(entered, axis=1)
        return torch.from_numpy(earliest)

    @cached_property
    def arrays(self) -> tuple[npt.NDArray[Any], ...]:
        """The arrays that `kernels` read, in their order.

        Successors are unsigned: that spares the check for an index from the end.
        """
        first = self.choice_to_branch.contiguous().numpy()
        ends = np.ascontiguousarray(first[:, :: self.num_actions])
        target = self.branch_target.numpy().view(np.uint32)
        tensors = (self.weight, self.expected_reward, self.earliest, self.horizon, self.initial)
        rest = (tensor.contiguous().numpy() for tensor in tensors)
        return (first, ends, target, *rest)

    @cached_property
    def most_branches(self) -> int:
        """Branches of the task that has most."""
        return int((self.choice_to_branch[:, -1] - self.choice_to_branch[:, 0]).max())

    def __getitem__(self, index: slice | Sequence[int] | Tensor) -> TaskBatch:
        """Return some of the tasks, in the order of `index`; what was worked out for them is kept."""
        chosen = index if isinstance(index, slice) else torch.as_tensor(index, dtype=torch.int64)
        some = replace(
            self,
            choice_to_branch=self.choice_to_branch[chosen],
            enabled=self.enabled[chosen],
            initial=self.initial[chosen],
            horizon=self.horizon[chosen],
        )
        vars(some).update(
            weight=self.weight, expected_reward=self.expected_reward[chosen], earliest=self.earliest[chosen]
        )
        return some


def ranges_between(begin: Ints, end: Ints) -> tuple[Ints, Ints]:
    """List the numbers of ranges one after the other, with the number of the range that each is of.

    Args:
        begin: int64 [R], first number of each range.
        end: int64 [R], one above its last.
    """
    counts = end - begin
    origin = np.repeat(np.arange(len(counts)), counts)
    return np.arange(len(origin)) - (counts.cumsum() - counts)[origin] + begin[origin], origin


def branch_batch(
    choice: Ints,
    target: Ints,
    prob: npt.ArrayLike,
    reward: npt.ArrayLike,
    continuation: npt.ArrayLike,
    enabled: npt.NDArray[np.bool_],
    initial: npt.ArrayLike,
    horizon: int | Sequence[int],
    discount: float,
    dtype: torch.dtype = torch.float32,
    features: Tensor | None = None,
) -> TaskBatch:
    """Put a list of branches into a batch; arguments as the fields of `TaskBatch`, as numpy arrays.

    `choice` is int [B], (n S + s) A + a, not decreasing; the horizon is that of all tasks, or one for each.
    """
    num_tasks = len(enabled)
    ends = np.searchsorted(choice, np.arange(enabled.size + 1))
    starts = ends[:-1].reshape(num_tasks, -1)
    closing = ends[starts.shape[1] :: starts.shape[1], np.newaxis]
    return TaskBatch(
        choice_to_branch=torch.from_numpy(np.hstack([starts, closing])),
        branch_target=torch.from_numpy(target.astype(np.int32)),
        branch_prob=torch.as_tensor(prob, dtype=dtype),
        branch_reward=torch.as_tensor(reward, dtype=dtype),
        branch_continuation=torch.as_tensor(continuation, dtype=dtype),
        enabled=torch.from_numpy(enabled),
        initial=torch.as_tensor(initial, dtype=dtype),
        horizon=torch.as_tensor(horizon, dtype=torch.int64).expand(num_tasks).clone(),
        discount=discount,
        features=features,
    )


def task_batch(
    models: Sequence[TabularMDP],
    horizon: int | Sequence[int],
    discount: float,
    dtype: torch.dtype = torch.float32,
    kinds: Sequence[VariableKind] | None = None,
) -> TaskBatch:
    """Put models of one case side by side.

    The reward of a branch is `branch_reward` where a model has it, else `choice_reward`.

    Args:
        models: N models on one index: same states and actions, the last action is `end`, and
            the label `done` marks the completed states.
        horizon: T of all tasks, at least 1, or one for each.
        discount: in [0, 1].
        dtype: of probabilities and rewards.
        kinds: of the variables, for the factored observation; None for what names and values tell.

    Raises:
        ModelError: there is no model, one is not on the index of the first, or a value is out
            of its variable's range.
    """
    if not models:
        raise ModelError("there is no model to learn from")
    for number, model in enumerate(models):
        _check_index(model, models[0], number)
    num_states, num_actions = models[0].num_states, models[0].num_actions - 1
    columns = [_acting_branches(model) for model in models]
    place, target, prob, reward, continuation = (
        np.concatenate(parts) for parts in zip(*columns, strict=True)
    )
    task = np.repeat(np.arange(len(models)), [len(column[0]) for column in columns])
    return branch_batch(
        task * (num_states * num_actions) + place,
        target,
        prob,
        reward,
        continuation,
        np.stack([model.enabled[:, :-1] for model in models]),
        np.stack([model.initial for model in models]),
        horizon,
        discount,
        dtype,
        _features(models[0], kinds or model_kinds(models[0])).to(dtype),
    )


def _features(model: TabularMDP, kinds: Sequence[VariableKind]) -> Tensor:
    return torch.from_numpy(observation_features(kinds, model.valuations, model.labels[COMPLETE_LABEL]))


def _check_index(model: TabularMDP, first: TabularMDP, number: int) -> None:
    if model.action_names != first.action_names or model.action_names[-1] != END_ACTION:
        raise ModelError(f"model {number} has actions {model.action_names}, not those of the case and `end`")
    if model.variable_names != first.variable_names or not np.array_equal(model.valuations, first.valuations):
        raise ModelError(f"model {number} has other states than model 0; models must be on one index")
    if COMPLETE_LABEL not in model.labels:
        raise ModelError(f"model {number} has no label {COMPLETE_LABEL!r}")


def _acting_branches(model: TabularMDP) -> tuple[npt.NDArray[np.generic], ...]:
    """s A + a, target, probability, reward and continuation of each branch that isn't `end`, by choice."""
    num_actions = model.num_actions - 1
    action = model.choice_action[model.branch_choice]
    place = model.choice_state[model.branch_choice] * num_actions + action
    order = np.flatnonzero(action != num_actions)
    order = order[np.argsort(place[order], kind="stable")]
    target = model.branch_target[order]
    going = ~model.labels[COMPLETE_LABEL][target]
    return place[order], target, model.branch_prob[order], model.mean_branch_reward[order], going
