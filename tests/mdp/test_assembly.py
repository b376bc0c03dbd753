from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.assembly import Branches, assemble, sum_by
from merap.mdp.model import TabularMDP

# state, action, target, probability, reward; out of order, with a repeated and an impossible branch
ROWS = [
    (1, 0, 1, 1.0, 0.0),
    (0, 1, 2, 0.5, 4.0),
    (0, 1, 0, 0.25, 1.0),
    (0, 1, 2, 0.25, 1.0),
    (0, 0, 1, 0.0, 9.0),
    (0, 0, 0, 1.0, -1.0),
    (2, 1, 1, 1.0, 2.0),
    (3, 0, 0, 1.0, 0.0),
]


def assembled(rows: list[tuple[int, int, int, float, float]], **changes: Any) -> TabularMDP:
    state, action, target, prob, reward = (np.array(column) for column in zip(*rows, strict=True))
    arguments: dict[str, Any] = {
        "initial": np.array([1.0, 0.0, 0.0, 0.0]),
        "labels": {"goal": np.array([False, True, False, False])},
        "valuations": np.arange(4)[:, None],
        "variable_names": ("loc",),
        "action_names": ("stay", "go"),
    }
    return assemble(Branches(state, action, target, prob, reward), **{**arguments, **changes})


def test_branches_are_sorted_and_equal_ones_merged() -> None:
    mdp = assembled(ROWS)
    assert mdp.state_to_choice.tolist() == [0, 2, 3, 4, 5]
    assert mdp.choice_action.tolist() == [0, 1, 0, 1, 0]
    assert mdp.choice_to_branch.tolist() == [0, 1, 3, 4, 5, 6]
    assert mdp.branch_target.tolist() == [0, 0, 2, 1, 1, 0]
    assert mdp.branch_prob.tolist() == [1.0, 0.25, 0.75, 1.0, 1.0, 1.0]
    # 0 -go-> 2 earns (0.5 * 4 + 0.25 * 1) / 0.75 = 3 on average
    assert mdp.branch_reward is not None
    assert mdp.branch_reward.tolist() == [-1.0, 1.0, 3.0, 0.0, 2.0, 0.0]
    # 0.25 * 1 + 0.75 * 3
    assert mdp.choice_reward.tolist() == [-1.0, 2.5, 0.0, 2.0, 0.0]


def test_reachable_is_what_branches_lead_to_from_the_start() -> None:
    assert assembled(ROWS).reachable.tolist() == [True, True, True, False]
    only_go = [row for row in ROWS if row[:2] != (0, 1)]
    assert assembled(only_go).reachable.tolist() == [True, False, False, False]
    several = assembled(only_go, initial=np.array([0.0, 0.5, 0.0, 0.5]))
    assert several.reachable.tolist() == [True, True, False, True]


def test_the_order_of_branches_does_not_matter() -> None:
    expected = assembled(ROWS)
    generator = np.random.default_rng(0)
    for _ in range(5):
        shuffled = assembled([ROWS[index] for index in generator.permutation(len(ROWS))])
        for declared in fields(TabularMDP):
            one, other = getattr(expected, declared.name), getattr(shuffled, declared.name)
            if isinstance(one, np.ndarray):
                assert np.array_equal(one, other), declared.name


def test_a_state_without_branches_has_no_choice_and_must_be_unreachable() -> None:
    mdp = assembled([row for row in ROWS if row[0] != 3])
    assert mdp.state_to_choice.tolist() == [0, 2, 3, 4, 4]
    with pytest.raises(ModelError, match=r"state \(loc=1\) has no action"):
        assembled([row for row in ROWS if row[0] != 1])


def test_probabilities_that_do_not_sum_to_one_are_refused() -> None:
    with pytest.raises(ModelError, match=r"\(loc=2\), action go: probabilities sum to 0.9, not 1"):
        assembled([(2, 1, 1, 0.9, 0.0) if row[0] == 2 else row for row in ROWS])


def test_a_negative_probability_is_refused_even_if_the_sum_is_one() -> None:
    rows = [row for row in ROWS if row[0] != 2] + [(2, 1, 1, 1.5, 0.0), (2, 1, 0, -0.5, 0.0)]
    with pytest.raises(ModelError, match=r"\(loc=2\), action go has a probability of -0.5"):
        assembled(rows)


def test_sums_of_groups_are_floats_even_of_nothing() -> None:
    assert sum_by(np.array([2, 0, 2]), np.array([1.0, 2.0, 4.0]), 4).tolist() == [2.0, 0.0, 5.0, 0.0]
    empty = sum_by(np.zeros(0, dtype=np.int64), np.zeros(0), 2)
    assert empty.tolist() == [0.0, 0.0]
    assert empty.dtype == np.float64
