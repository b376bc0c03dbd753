"""Outcome sets of an explicit list of models, such as a model base with weights.

Axes: N models, and those of `outcomes`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from merap.errors import InputError, ModelError
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION, UNSAFE_LABEL
from merap.shield.outcomes import OutcomeSets, Rows, distinct, rows


@dataclass(frozen=True, eq=False)
class ModelSets:
    """The distributions of N models, each kept once; a subset of the models is taken in no time.

    Attributes:
        num_actions: A, without `end`, which only completed states have.
        rows: R distinct distributions, by choice.
        kind: int64 [choices of all models], the row of each.
        model: int64 [choices of all models], whose it is.
        exists: bool [N, S], the state is reachable under the model and not completed.
        unsafe: bool [N, S].
    """

    num_actions: int
    rows: Rows
    kind: Ints
    model: Ints
    exists: Bools
    unsafe: Bools

    def outcomes(self, credible: Bools) -> OutcomeSets:
        """The sets of the models bool [N] that are credible.

        Raises:
            InputError: none is.
        """
        if not credible.any():
            raise InputError("a shield needs at least one model that is credible")
        entry = credible[self.model]
        used = np.zeros(len(self.rows.choice), dtype=np.bool_)
        used[self.kind[entry]] = True
        kept = self.rows.taken(used)
        choice, first = np.unique(kept.choice, return_index=True)
        size = self.exists.shape[1] * self.num_actions
        enabling = np.bincount(self.rows.choice[self.kind[entry]], minlength=size)
        holding = np.repeat(self.exists[credible].sum(axis=0), self.num_actions)
        return OutcomeSets(
            num_actions=self.num_actions,
            choice=choice,
            first=first,
            rows=kept,
            sure=(enabling == holding)[choice],
            unsafe=np.asarray(self.unsafe[credible].any(axis=0)),
        )


def model_sets(models: Sequence[TabularMDP], unsafe: Bools | None = None) -> ModelSets:
    """Lay out models for shields.

    A completed state has no choices here: nothing more can happen. Where a canonical model
    completes the task in an unsafe state, this can't be seen, since complete states are one.

    Args:
        models: N with the same states and actions, as on a canonical index; `end` is the last action if
            they have it.
        unsafe: bool [S]; None: their label `unsafe`.

    Raises:
        InputError: there is no model, or one has no such label.
        ModelError: one has other states or actions than the first.
    """
    if not models:
        raise InputError("a shield needs at least one model")
    for number, model in enumerate(models):
        if model.action_names != models[0].action_names or model.num_states != models[0].num_states:
            raise ModelError(f"model {number} has other states or actions than model 0")
        if unsafe is None and UNSAFE_LABEL not in model.labels:
            raise InputError(f"model {number} has no label {UNSAFE_LABEL!r}: nothing to shield from")
    width = max(int(np.diff(model.choice_to_branch).max(initial=0)) for model in models)
    exists = np.stack([model.reachable & ~_completed(model) for model in models])
    going = [here[model.choice_state] for model, here in zip(models, exists, strict=True)]

    num_actions = models[0].num_actions - (END_ACTION in models[0].action_names)

    def found() -> Iterator[Rows]:
        for model, kept in zip(models, going, strict=True):
            yield _rows(model, kept, width, num_actions)

    representative, kind = distinct(lambda: (one.codes for one in found()))
    table = _gathered(found(), representative)
    order = np.argsort(table.choice, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return ModelSets(
        num_actions=num_actions,
        rows=table.taken(order),
        kind=place[kind],
        model=np.repeat(np.arange(len(models)), [int(kept.sum()) for kept in going]),
        exists=exists,
        unsafe=np.stack([model.labels[UNSAFE_LABEL] if unsafe is None else unsafe for model in models]),
    )


def _completed(model: TabularMDP) -> Bools:
    return model.labels.get(COMPLETE_LABEL, np.zeros(model.num_states, dtype=np.bool_))


def _rows(model: TabularMDP, kept: Bools, width: int, num_actions: int) -> Rows:
    """A row for each choice that is kept."""
    slot = np.arange(model.num_branches) - model.choice_to_branch[model.branch_choice]
    target = np.zeros((model.num_choices, width), dtype=np.int64)
    prob = np.zeros((model.num_choices, width))
    target[model.branch_choice, slot] = model.branch_target
    prob[model.branch_choice, slot] = model.branch_prob
    choice = model.choice_state * num_actions + model.choice_action
    return rows(choice[kept], target[kept], prob[kept], np.zeros_like(prob[kept]))


def _gathered(blocks: Iterator[Rows], representative: Ints) -> Rows:
    """The rows with these numbers, counted through all blocks."""
    parts, numbers, begin = [], [], 0
    for block in blocks:
        mine = np.flatnonzero((representative >= begin) & (representative < begin + len(block.choice)))
        parts.append(block.taken(representative[mine] - begin))
        numbers.append(mine)
        begin += len(block.choice)
    joined = Rows(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("choice", "target", "prob", "risk")
        )
    )
    return joined.taken(np.argsort(np.concatenate(numbers)))


def credible_models(prior: Floats, posterior: Floats, doubt: float) -> Bools:
    """The hypotheses that observations have not refuted.

    A hypothesis is credible while posterior / prior > doubt. Under the hypothesis that is true,
    prior / posterior is a nonnegative martingale of mean 1 (the mixture's likelihood over its own),
    so by Ville's inequality it is ever dropped with probability at most `doubt`, whatever its prior
    (the prior-posterior ratio of Waudby-Smith and Ramdas 2020). Those dropped hold at most `doubt`
    of the posterior.

    Args:
        prior: float64 [...], weights.
        posterior: float64 [...].
        doubt: in [0, 1).

    Returns:
        bool [...].
    """
    return np.asarray(posterior > doubt * prior)
