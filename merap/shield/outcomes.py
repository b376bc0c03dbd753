"""What each action may lead to: for every state and action a finite set of distributions.

The sets are *rectangular* (Iyengar 2005; Nilim and El Ghaoui 2005): in each state and action,
and each time it is taken, nature picks a distribution of the set anew. This contains every
single model, so what holds for the sets holds for each of them; and the worst case of a linear
function over a set is that over its convex hull, so the ends of an interval are enough.

Axes: S states, C choices (a state and one of its actions), R distributions, K successors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from merap.errors import ModelError
from merap.mdp.csr import pointers_of
from merap.mdp.model import Bools, Floats, Ints

Hashes = npt.NDArray[np.uint64]
Scalar = TypeVar("Scalar", np.float64, np.bool_)


@dataclass(frozen=True, eq=False)
class Rows:
    """Distributions over successors in any order; equal ones may occur repeatedly.

    Attributes:
        choice: int64 [R], state * A + action.
        target: int64 [R, K].
        prob: float64 [R, K], sums to 1; slots of probability 0 lead to state 0.
        risk: float64 [R, K], probability that going there is a violation by itself.
    """

    choice: Ints
    target: Ints
    prob: Floats
    risk: Floats

    @property
    def codes(self) -> Ints:
        """int64 [R, 1 + 3 K], equal where rows are equal."""
        return np.column_stack([self.choice, self.target, self.prob.view(np.int64), self.risk.view(np.int64)])

    def taken(self, which: Ints | Bools) -> Rows:
        """Some of the rows."""
        return Rows(self.choice[which], self.target[which], self.prob[which], self.risk[which])


def rows(choice: Ints, target: Ints, prob: Floats, risk: Floats) -> Rows:
    """Rows in their normal form, in which slots of probability 0 don't tell rows apart."""
    used = prob > 0
    return Rows(choice, np.where(used, target, 0), np.where(used, prob, 0.0), np.where(used, risk, 0.0))


@dataclass(frozen=True, eq=False)
class OutcomeSets:
    """Sets of distributions for all choices, with the states to avoid.

    Attributes:
        num_actions: A.
        choice: int64 [C], state * A + action, ascending.
        first: int64 [C], the first row of each choice.
        rows: R distributions, by choice.
        sure: bool [C], the action is enabled under every credible model in which the state exists.
        unsafe: bool [S].
    """

    num_actions: int
    choice: Ints
    first: Ints
    rows: Rows
    sure: Bools
    unsafe: Bools

    def __post_init__(self) -> None:
        sums = self.rows.prob.sum(axis=1)
        wrong = np.flatnonzero(np.abs(sums - 1) > 1e-9)
        if len(wrong):
            state, action = divmod(int(self.rows.choice[wrong[0]]), self.num_actions)
            raise ModelError(
                f"state {state}, action {action}: the outcomes' probabilities sum to {sums[wrong[0]]}, not 1"
            )

    @property
    def num_states(self) -> int:
        """S."""
        return len(self.unsafe)

    @cached_property
    def state_pointers(self) -> Ints:
        """int64 [S + 1], the choices of each state."""
        return pointers_of(np.bincount(self.choice // self.num_actions, minlength=self.num_states))

    @property
    def acting(self) -> Bools:
        """bool [S], an episode can go on there: some credible model has an action."""
        return np.asarray(np.diff(self.state_pointers) > 0)

    def table(self, of_choices: npt.NDArray[Scalar], missing: Scalar | float) -> npt.NDArray[Scalar]:
        """[S, A] of [C]; `missing` where no credible model has the action."""
        dense = np.full(self.num_states * self.num_actions, missing, dtype=of_choices.dtype)
        dense[self.choice] = of_choices
        return dense.reshape(self.num_states, self.num_actions)


def outcome_sets(found: Rows, sure: Bools, unsafe: Bools, num_actions: int) -> OutcomeSets:
    """Sort rows and keep one of each.

    Args:
        found: rows.
        sure: bool [S, A], whether the action is enabled under every credible model.
        unsafe: bool [S].
        num_actions: A.
    """
    codes = found.codes
    kept = found.taken(distinct(lambda: [codes])[0])
    kept = kept.taken(np.argsort(kept.choice, kind="stable"))
    choice, first = np.unique(kept.choice, return_index=True)
    return OutcomeSets(num_actions, choice, first, kept, sure.ravel()[choice], unsafe)


def distinct(blocks: Callable[[], Iterable[Ints]]) -> tuple[Ints, Ints]:
    """One of each of equal rows, without a sort of whole rows.

    Rows are compared by a hash, and then with the row that stands for them; should two that
    differ have one hash, another hash is tried.

    Args:
        blocks: gives int64 [R_i, X] each, the same each time.

    Returns:
        int64 [U], a row for each kind, and int64 [R], the kind of each row.
    """
    generator = np.random.default_rng(0)
    while True:
        salt = generator.integers(2**63, size=4096, dtype=np.uint64)
        hashes = np.concatenate([_hashes(block, salt) for block in blocks()])
        _, representative, kind = np.unique(hashes, return_index=True, return_inverse=True)
        if _agree(blocks, representative, kind):
            return representative, kind


def _hashes(block: Ints, salt: Hashes) -> Hashes:
    mixed = np.zeros(len(block), dtype=np.uint64)
    for column, number in zip(block.view(np.uint64).T, salt, strict=False):
        mixed = (mixed ^ column ^ number) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return mixed


def _agree(blocks: Callable[[], Iterable[Ints]], representative: Ints, kind: Ints) -> bool:
    """Whether each row equals the one that stands for it."""
    standing, begin = [], 0
    for block in blocks():
        mine = (representative >= begin) & (representative < begin + len(block))
        standing.append((np.flatnonzero(mine), block[representative[mine] - begin]))
        begin += len(block)
    order = np.argsort(np.concatenate([kinds for kinds, _ in standing]))
    table = np.concatenate([found for _, found in standing])[order]
    begin = 0
    for block in blocks():
        if not np.array_equal(block, table[kind[begin : begin + len(block)]]):
            return False
        begin += len(block)
    return True
