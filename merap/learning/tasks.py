"""Tasks of one case as padded torch arrays on the canonical index.

Axes: N tasks, S states, A actions without `end`, K successors, F features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from merap.errors import ModelError
from merap.learning.observation import VariableKind, model_kinds, observation_features
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION


@dataclass(frozen=True, eq=False)
class TaskBatch:
    """Several MDPs side by side; entries that pad K have probability 0 and stay in the state.

    The end of an episode is a continuation of 0. The completed state has no enabled action,
    nor has a state that is unreachable in a task.

    Attributes:
        next_state: int64 [N, S, A, K].
        prob: float [N, S, A, K], sums to 1 over K where the action is enabled.
        reward: float [N, S, A, K], r(s, a, s').
        continuation: float [N, S, A, K], 0 into the completed state, else 1.
        enabled: bool [N, S, A].
        initial: float [N, S], a distribution.
        horizon: T, the number of steps of an episode.
        discount: in [0, 1].
        features: float [S, F], the factored observation; None if it isn't known.
    """

    next_state: Tensor
    prob: Tensor
    reward: Tensor
    continuation: Tensor
    enabled: Tensor
    initial: Tensor
    horizon: int
    discount: float
    features: Tensor | None = None

    def __post_init__(self) -> None:
        shape = self.next_state.shape
        assert len(shape) == 4, shape
        for array in (self.prob, self.reward, self.continuation):
            assert array.shape == shape, (array.shape, shape)
        assert self.enabled.shape == shape[:3], (self.enabled.shape, shape)
        assert self.initial.shape == shape[:2], (self.initial.shape, shape)
        assert self.features is None or len(self.features) == shape[1], (self.features.shape, shape)

    @property
    def num_tasks(self) -> int:
        """N."""
        return self.next_state.shape[0]

    @property
    def num_states(self) -> int:
        """S."""
        return self.next_state.shape[1]

    @property
    def num_actions(self) -> int:
        """A."""
        return self.next_state.shape[2]

    @property
    def num_successors(self) -> int:
        """K."""
        return self.next_state.shape[3]

    @property
    def dtype(self) -> torch.dtype:
        """Of probabilities and rewards."""
        return self.prob.dtype

    @cached_property
    def expected_reward(self) -> Tensor:
        """float [N, S, A], r(s, a)."""
        return (self.prob * self.reward).sum(dim=-1)

    @cached_property
    def survival(self) -> Tensor:
        """float [N, S, A, K], the probability to go on in each successor."""
        return self.prob * self.continuation

    def __getitem__(self, index: slice | Sequence[int] | Tensor) -> TaskBatch:
        """Some of the tasks, in the order of `index`."""
        chosen = index if isinstance(index, slice) else torch.as_tensor(index, dtype=torch.int64)
        return TaskBatch(
            next_state=self.next_state[chosen],
            prob=self.prob[chosen],
            reward=self.reward[chosen],
            continuation=self.continuation[chosen],
            enabled=self.enabled[chosen],
            initial=self.initial[chosen],
            horizon=self.horizon,
            discount=self.discount,
            features=self.features,
        )


def task_batch(
    models: Sequence[TabularMDP],
    horizon: int,
    discount: float,
    dtype: torch.dtype = torch.float32,
    kinds: Sequence[VariableKind] | None = None,
) -> TaskBatch:
    """Stack models of one case.

    The reward of a branch is `branch_reward` where a model has it, else `choice_reward`.

    Args:
        models: N canonical models: same states and actions, the last action is `end`, and
            the label `done` marks the completed states.
        horizon: T, at least 1.
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
    num_successors = max(int(np.diff(model.choice_to_branch).max()) for model in models)
    shape = (len(models), models[0].num_states, models[0].num_actions - 1, num_successors)
    next_state, prob, reward, continuation = _empty_arrays(shape)
    for n, model in enumerate(models):
        place = _places(model)
        next_state[(n, *place)] = model.branch_target[_acting(model)]
        prob[(n, *place)] = model.branch_prob[_acting(model)]
        reward[(n, *place)] = model.mean_branch_reward[_acting(model)]
        continuation[(n, *place)] = ~model.labels[COMPLETE_LABEL][model.branch_target[_acting(model)]]
    return TaskBatch(
        next_state=torch.from_numpy(next_state),
        prob=torch.from_numpy(prob).to(dtype),
        reward=torch.from_numpy(reward).to(dtype),
        continuation=torch.from_numpy(continuation).to(dtype),
        enabled=torch.from_numpy(np.stack([model.enabled[:, :-1] for model in models])),
        initial=torch.from_numpy(np.stack([model.initial for model in models])).to(dtype),
        horizon=horizon,
        discount=discount,
        features=observation_features(kinds or model_kinds(models[0]), models[0].valuations).to(dtype),
    )


def _check_index(model: TabularMDP, first: TabularMDP, number: int) -> None:
    if model.action_names != first.action_names or model.action_names[-1] != END_ACTION:
        raise ModelError(f"model {number} has actions {model.action_names}, not those of the case and `end`")
    if model.variable_names != first.variable_names or not np.array_equal(model.valuations, first.valuations):
        raise ModelError(f"model {number} has other states than model 0; models must be canonical")
    if COMPLETE_LABEL not in model.labels:
        raise ModelError(f"model {number} has no label {COMPLETE_LABEL!r}")


def _empty_arrays(shape: tuple[int, int, int, int]) -> tuple[Ints, Floats, Floats, Floats]:
    own_state = np.arange(shape[1])[:, np.newaxis, np.newaxis]
    return np.broadcast_to(own_state, shape).copy(), np.zeros(shape), np.zeros(shape), np.zeros(shape)


def _acting(model: TabularMDP) -> Bools:
    """bool [B], branches of every action but `end`."""
    acting: Bools = model.choice_action[model.branch_choice] != model.num_actions - 1
    return acting


def _places(model: TabularMDP) -> tuple[Ints, Ints, Ints]:
    """State, action and number among its choice's branches of each branch that isn't `end`."""
    choice = model.branch_choice[_acting(model)]
    rank = np.arange(model.num_branches)[_acting(model)] - model.choice_to_branch[choice]
    return model.choice_state[choice], model.choice_action[choice], rank
