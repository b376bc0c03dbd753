"""The index of a family: one numbering of states and actions for all of its members.

Axes: S states of the index, V variables, L labels.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.errors import ModelError
from merap.mdp.alignment import align_actions, align_variables
from merap.mdp.completion import complete_states, label_sets, require_closed
from merap.mdp.csr import pointers_of
from merap.mdp.matching import first_repeat, match_rows
from merap.mdp.model import Bools, Ints, TabularMDP
from merap.mdp.placement import placed_branches
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION, FLAG_VARIABLE
from merap.mdp.short_repr import ShortRepr


@dataclass(frozen=True, eq=False, repr=False)
class FamilyIndex(ShortRepr):
    """One numbering of states and actions for all members of a family.

    States are told apart by their valuations. Complete states, in which nothing changes any more, are one
    state for each set of labels, called a completed state. The number of a state never changes: states that
    are found later stand behind the others.

    Attributes:
        variable_names: V names.
        valuations: int64 [S, V], distinct; those of completed states are below every other and mean nothing.
        completed: number of the completed state for each set of labels, which does not hold `done` itself.
        actions: declared names, without `end`.

    Raises:
        ModelError: a declared action is called `end`.
    """

    variable_names: tuple[str, ...]
    valuations: Ints
    completed: Mapping[frozenset[str], int]
    actions: tuple[str, ...]

    def __post_init__(self) -> None:
        if END_ACTION in self.actions:
            raise ModelError(f"action {END_ACTION!r} is reserved, it must not be declared")

    @property
    def num_states(self) -> int:
        """S."""
        return len(self.valuations)

    @cached_property
    def completed_rows(self) -> Ints:
        """int64, the numbers of the completed states, rising."""
        return np.sort(np.array(list(self.completed.values()), dtype=np.int64))

    @cached_property
    def is_completed(self) -> Bools:
        """bool [S], the completed states."""
        return _marked(self.completed_rows, self.num_states)

    def extended(self, *models: TabularMDP) -> FamilyIndex:
        """Return the index with all states of some models: what it lacks is appended, in rising order.

        Args:
            *models: whole models, as Storm and `explore` make them, or models on an index.

        Raises:
            ModelError: a variable or label is missing, or a complete state does anything but `end`.
        """
        sets: dict[frozenset[str], None] = {}
        rows = [self.valuations[:0]]
        for model in models:
            complete = complete_states(model)
            found, _ = label_sets(model, np.flatnonzero(complete & model.reachable))
            sets |= {one: None for one in found if self._completed(one, model.labels) is None}
            rows.append(self._aligned(model, np.flatnonzero(model.reachable & ~complete)))
        known = self.valuations[~self.is_completed]
        distinct = np.unique(np.concatenate(rows), axis=0)
        return self._with(sorted(sets, key=_order), distinct[match_rows(distinct, known) < 0])

    def with_valuations(self, valuations: Ints) -> FamilyIndex:
        """Return the index with some valuations, int64 [M, V]; those that it lacks are appended, rising."""
        known = self.valuations[~self.is_completed]
        distinct = np.unique(valuations, axis=0)
        return self._with([], distinct[match_rows(distinct, known) < 0])

    def _with(self, sets: Iterable[frozenset[str]], rows: Ints) -> FamilyIndex:
        numbers = dict(self.completed)
        for one in sets:
            numbers[one] = self.num_states + len(numbers) - len(self.completed)
        width, places = len(self.variable_names), np.sort(np.array(list(numbers.values()), dtype=np.int64))
        valued = np.concatenate([self.valuations[~self.is_completed], rows])
        table = np.empty((len(valued) + len(places), width), dtype=np.int64)
        table[~_marked(places, len(table))] = valued
        table[places] = values_below(valued, len(places))
        table.flags.writeable = False
        return replace(self, valuations=table, completed=numbers)

    def number(self, model: TabularMDP) -> Ints:
        """int64 [S'], the number of each reachable state of a model; -1 for the others.

        Args:
            model: a whole model, or a model on an index.

        Raises:
            ModelError: the index lacks a state, or two states of the model are one of the index.
        """
        complete = complete_states(model)
        row = np.full(model.num_states, -1)
        states = np.flatnonzero(model.reachable & ~complete)
        row[states] = self._number_of_valuations(model, states)
        ended = np.flatnonzero(model.reachable & complete)
        sets, which = label_sets(model, ended)
        numbers = [self._completed(one, model.labels) for one in sets]
        if None in numbers:
            labels = ", ".join(sorted(sets[numbers.index(None)])) or "none"
            raise ModelError(f"the index has no completed state with the labels: {labels}")
        row[ended] = np.array(numbers, dtype=np.int64)[which]
        return row

    def _completed(self, labels: frozenset[str], known: Iterable[str]) -> int | None:
        """Return the first completed state that has some labels, of the known ones; None: there is none."""
        every = frozenset(known)
        return min((number for one, number in self.completed.items() if one & every == labels), default=None)

    def numbers_on(self, other: FamilyIndex) -> Ints:
        """int64 [S], the number of each state on another index; -1 where that lacks it."""
        numbers = np.full(self.num_states, -1)
        valued, theirs = np.flatnonzero(~self.is_completed), np.flatnonzero(~other.is_completed)
        place = match_rows(self.valuations[valued], other.valuations[theirs])
        numbers[valued] = np.where(place < 0, -1, theirs[place] if len(theirs) else -1)
        every = frozenset().union(*self.completed)
        for one, number in self.completed.items():
            there = other._completed(one & frozenset().union(*other.completed), every)
            numbers[number] = -1 if there is None else there
        return numbers

    def _number_of_valuations(self, model: TabularMDP, states: Ints) -> Ints:
        valued = np.flatnonzero(~self.is_completed)
        place = match_rows(self._aligned(model, states), self.valuations[valued])
        unknown = np.flatnonzero(place < 0)
        if len(unknown):
            state = model.describe_state(int(states[unknown[0]]))
            raise ModelError(f"state {state} is not among the {len(valued)} states of the index")
        repeated = first_repeat(place)
        if repeated is not None:
            one, other = (model.describe_state(int(states[position])) for position in repeated)
            raise ModelError(f"states {one} and {other}, neither complete, are one state of the index")
        numbers: Ints = valued[place]
        return numbers

    def _aligned(self, model: TabularMDP, states: Ints) -> Ints:
        """int64 [len(states), V]; the model may have `done` as a variable beside those of the index."""
        names, width = self.variable_names, len(self.variable_names)
        if FLAG_VARIABLE in model.variable_names and FLAG_VARIABLE not in names:
            names = (*names, FLAG_VARIABLE)
        return align_variables(model, names)[states, :width]

    def place(self, model: TabularMDP) -> TabularMDP:
        """Put a model on the index.

        Choices are ordered by state and action and branches by target, so equal models become equal arrays.

        Args:
            model: a whole model, or a model on an index; unreachable states are ignored.

        Returns:
            A model of S states whose actions are the declared ones and, last, `end`, the only choice of
            completed states (reward 0). Rows of other states that the model does not reach are empty.
            `done` labels the completed states. Branches of one choice into one completed state become one,
            with the mean reward.

        Raises:
            ModelError: variables or actions differ, the index lacks a state, or a complete state does
                anything but `end`.
        """
        complete = complete_states(model)
        require_closed(model, complete)
        row, kept = self.number(model), model.reachable & ~complete
        action = self._actions_of(model, kept)
        choices, ends = np.flatnonzero(kept[model.choice_state]), self.completed_rows
        of_choices = np.concatenate([row[model.choice_state[choices]], ends])
        actions = np.concatenate([action[choices], np.full(len(ends), len(self.actions))])
        order = np.lexsort((actions, of_choices))
        rewards = np.concatenate([model.choice_reward[choices], np.zeros(len(ends))])
        return TabularMDP(
            **placed_branches(model, choices, order, row, ends, self.num_states),
            state_to_choice=pointers_of(np.bincount(of_choices, minlength=self.num_states)),
            choice_action=actions[order],
            choice_reward=rewards[order],
            initial=np.bincount(
                row[model.reachable], model.initial[model.reachable], minlength=self.num_states
            ).astype(np.float64),
            reachable=_marked(row[model.reachable], self.num_states),
            labels=self._labels(model, row, kept),
            valuations=self.valuations,
            variable_names=self.variable_names,
            action_names=(*self.actions, END_ACTION),
        )

    def _actions_of(self, model: TabularMDP, kept: Bools) -> Ints:
        """int64 [C'], the declared number of each choice's action; checked where states are kept."""
        action = align_actions(model, self.actions)[model.choice_action]
        unknown = np.flatnonzero(kept[model.choice_state] & (action < 0))
        if len(unknown):
            choice = model.describe_choice(int(unknown[0]))
            raise ModelError(f"{choice}: the case declares only {', '.join(self.actions)}")
        return action

    def _labels(self, model: TabularMDP, row: Ints, kept: Bools) -> dict[str, Bools]:
        labels = {}
        for name in model.labels.keys() - {COMPLETE_LABEL}:
            labels[name] = _marked(row[kept & model.labels[name]], self.num_states)
            labels[name][[number for one, number in self.completed.items() if name in one]] = True
        return {**labels, COMPLETE_LABEL: self.is_completed}


def new_index(
    variable_names: tuple[str, ...],
    actions: tuple[str, ...],
    valuations: Ints | None = None,
    label_sets: Iterable[frozenset[str]] = (),
) -> FamilyIndex:
    """Return an index: first a completed state for each set of labels, then states in the given order.

    Args:
        variable_names: V names.
        actions: declared names, without `end`.
        valuations: int64 [M, V], distinct; None: there are no states yet.
        label_sets: distinct.
    """
    empty = np.zeros((0, len(variable_names)), dtype=np.int64)
    index = FamilyIndex(variable_names, empty, {}, actions)
    return index._with(label_sets, empty if valuations is None else valuations)


def index_of(model: TabularMDP) -> FamilyIndex:
    """Return the index that a model is on; its last action is `end`, or it has no label `done`."""
    rows = np.flatnonzero(complete_states(model))
    sets, which = label_sets(model, rows)
    completed = {sets[place]: row for row, place in zip(rows.tolist(), which.tolist(), strict=True)}
    actions = tuple(name for name in model.action_names if name != END_ACTION)
    return FamilyIndex(model.variable_names, model.valuations, completed, actions)


def carried(
    table: npt.NDArray[Any], source: FamilyIndex, target: FamilyIndex, missing: Any
) -> npt.NDArray[Any]:
    """Return a table of the states of one index for those of another one.

    Args:
        table: [.., S, A].
        source: S states.
        target: S' states.
        missing: the entries of states that `source` lacks.

    Returns:
        [.., S', A].
    """
    numbers = target.numbers_on(source)
    known = numbers >= 0
    found = np.full((*table.shape[:-2], len(numbers), table.shape[-1]), missing, dtype=table.dtype)
    found[..., known, :] = table[..., numbers[known], :]
    return found


def values_below(valuations: Ints, count: int) -> Ints:
    """int64 [count, V], distinct values below those of all valuations [S, V] and below 0."""
    below: Ints = valuations.min(axis=0, initial=0) - 1 - np.arange(count)[:, np.newaxis]
    return below


def _order(labels: frozenset[str]) -> tuple[int, list[str]]:
    return len(labels), sorted(labels)


def _marked(rows: Ints, size: int) -> Bools:
    mask = np.zeros(size, dtype=np.bool_)
    mask[rows] = True
    return mask
