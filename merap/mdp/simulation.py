"""Lay out the models of one case for sampling: a step of any number of episodes is a draw and some gathers.

Axes: N models, B episodes side by side, S states, A actions without `end`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.errors import ModelError
from merap.mdp.csr import pointers_of
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION


@dataclass(frozen=True, eq=False)
class CategoricalSampler:
    """Discrete distributions in compressed rows, cumulated so that one binary search draws from any.

    With 10^6 rows a probability is kept to 10^-10, since the number of the row takes part
    of the mantissa.

    Attributes:
        bound: float64, ascending: the number of the entry's row plus the probability up to
            the entry.
        last: int64 [R], the last entry of each row.
    """

    bound: Floats
    last: Ints

    def draw(self, row: Ints | int, uniform: Floats | float) -> Ints:
        """Draw an entry of each row by inversion.

        Args:
            row: int64 [B].
            uniform: float64 [B], in [0, 1).

        Returns:
            int64 [B], indices of entries.
        """
        entry = self.bound.searchsorted(row + uniform, side="right")
        # row + uniform may be rounded up to row + 1.
        drawn: Ints = np.minimum(entry, self.last[row])
        return drawn


@dataclass(frozen=True, eq=False)
class Simulator:
    """N models of one case; state s of model n has number n * S + s.

    Attributes:
        choice: int64 [N * S, A], a row of `successors`; -1 where the action is disabled or
            the state is completed.
        successors: the branches of each choice.
        target: int64 [branches of all models], a state's number.
        reward: float64 [branches of all models], r(s, a, s').
        completed: bool [N * S], where an episode ends.
        starts: the initial states of each model that have a positive probability.
        start: int64, a state's number for each entry of `starts`.
        num_models: N.
        num_states: S.
        action_names: A names.
    """

    choice: Ints
    successors: CategoricalSampler
    target: Ints
    reward: Floats
    completed: Bools
    starts: CategoricalSampler
    start: Ints
    num_models: int
    num_states: int
    action_names: tuple[str, ...]

    def first_states(self, model: Ints | int, uniform: Floats | float) -> Ints:
        """Draw int64 [B], initial states of the models int64 [B], by float64 [B] uniform in [0, 1)."""
        first: Ints = self.start[self.starts.draw(model, uniform)]
        return first


def simulator(models: Sequence[TabularMDP]) -> Simulator:
    """Lay out models for sampling.

    An episode ends in the states labelled `done`, if there is such a label; the action
    `end`, which only they have, is then none of the actions. A model without the label
    goes on for ever.

    Args:
        models: N models with the same states and actions, as on a canonical index.

    Raises:
        ModelError: there is no model, one has other states or actions than the first, one
            can start in a completed state, or `end` is possible in a state that is not.
    """
    if not models:
        raise ModelError("there is no model to simulate")
    for number, model in enumerate(models):
        _check_index(model, models[0], number)
        _check_end(model)
    names = _acting_names(models[0])
    choices = pointers_of(np.array([model.num_choices for model in models]))
    num_states = models[0].num_states
    return Simulator(
        choice=np.concatenate(
            [
                _choice_table(model, len(names), int(base))
                for model, base in zip(models, choices, strict=False)
            ]
        ),
        successors=_categorical_sampler(
            pointers_of(np.concatenate([np.diff(model.choice_to_branch) for model in models])),
            np.concatenate([model.branch_prob for model in models]),
        ),
        target=np.concatenate([model.branch_target + n * num_states for n, model in enumerate(models)]),
        reward=np.concatenate([model.mean_branch_reward for model in models]),
        completed=np.concatenate([_completed(model) for model in models]),
        starts=_categorical_sampler(
            pointers_of(np.array([np.count_nonzero(model.initial) for model in models])),
            np.concatenate([model.initial[model.initial > 0] for model in models]),
        ),
        start=np.concatenate(
            [np.flatnonzero(model.initial) + n * num_states for n, model in enumerate(models)]
        ),
        num_models=len(models),
        num_states=num_states,
        action_names=names,
    )


def _check_index(model: TabularMDP, first: TabularMDP, number: int) -> None:
    if model.action_names != first.action_names:
        raise ModelError(f"model {number} has actions {model.action_names}, model 0 {first.action_names}")
    if model.variable_names != first.variable_names or not np.array_equal(model.valuations, first.valuations):
        raise ModelError(f"model {number} has other states than model 0; bring both to one canonical index")
    if (COMPLETE_LABEL in model.labels) != (COMPLETE_LABEL in first.labels):
        raise ModelError(f"only one of model 0 and model {number} has the label {COMPLETE_LABEL!r}")


def _check_end(model: TabularMDP) -> None:
    started = np.flatnonzero(_completed(model) & (model.initial > 0))
    if len(started):
        state = model.describe_state(int(started[0]))
        raise ModelError(f"the initial state {state} is completed already: no episode can start there")
    if COMPLETE_LABEL not in model.labels or END_ACTION not in model.action_names:
        return
    ending = model.choice_action == model.action_names.index(END_ACTION)
    early = np.flatnonzero(ending & ~_completed(model)[model.choice_state])
    if len(early):
        raise ModelError(f"{model.describe_choice(int(early[0]))}: only a completed state may have it")


def _acting_names(model: TabularMDP) -> tuple[str, ...]:
    if COMPLETE_LABEL not in model.labels:
        return model.action_names
    return tuple(name for name in model.action_names if name != END_ACTION)


def _completed(model: TabularMDP) -> Bools:
    if COMPLETE_LABEL in model.labels:
        return model.labels[COMPLETE_LABEL]
    return np.zeros(model.num_states, dtype=np.bool_)


def _choice_table(model: TabularMDP, num_actions: int, base: int) -> Ints:
    """Return int64 [S, A], numbers of choices from `base` on; -1 where there is none."""
    names = _acting_names(model)
    column = np.array([names.index(name) if name in names else -1 for name in model.action_names])
    going = ~_completed(model)[model.choice_state]
    table = np.full((model.num_states, num_actions), -1)
    table[model.choice_state[going], column[model.choice_action[going]]] = np.flatnonzero(going) + base
    return table


def _categorical_sampler(pointers: Ints, prob: Floats) -> CategoricalSampler:
    """Build a sampler from rows of float64 probabilities, none of them empty."""
    row = np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
    cumulated = np.cumsum(prob)
    before = np.append(0.0, cumulated)[pointers[:-1]]
    total = cumulated[pointers[1:] - 1] - before
    return CategoricalSampler(row + (cumulated - before[row]) / total[row], pointers[1:] - 1)
