"""TabularMDP: its invariants, its derived arrays, its graph."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.csr import first_match, pointers_of, ragged_indices, row_best
from merap.mdp.graph import attractor, restrict_to_reachable, surely_reaching
from merap.mdp.matching import first_repeat, match_rows, row_keys
from merap.mdp.model import TabularMDP
from tests.support.mdp_examples import end_component_trap, make_mdp, puterman_two_states, random_mdp
from tests.support.mdp_routes import dense


def unreachable_tail() -> TabularMDP:
    """Two reachable states, then one with a choice and one without."""
    return make_mdp(
        {
            (0,): {"go": (1.0, {(1,): 1.0})},
            (1,): {"go": (2.0, {(0,): 0.25, (1,): 0.75}), "rest": (0.0, {(1,): 1.0})},
            (2,): {"go": (3.0, {(3,): 1.0})},
            (3,): {},
        },
        labels={"late": {(1,), (3,)}},
    )


def test_derived_arrays_of_the_two_state_example() -> None:
    mdp = puterman_two_states()
    assert (mdp.num_states, mdp.num_choices, mdp.num_branches, mdp.num_actions) == (2, 3, 4, 3)
    assert mdp.choice_state.tolist() == [0, 0, 1]
    assert mdp.branch_choice.tolist() == [0, 0, 1, 2]
    assert mdp.enabled.tolist() == [[True, True, False], [False, False, True]]
    assert mdp.transitions.toarray().tolist() == [[0.5, 0.5], [0, 1], [0, 1]]
    assert mdp.describe_choice(1) == "(s=1), action a12"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"branch_prob": [0.5, 0.4, 1, 1]}, r"\(s=1\), action a11: probabilities sum to 0.9, not 1"),
        ({"branch_prob": [1.0, 0.0, 1, 1]}, r"\(s=1\), action a11 has a probability of 0.0"),
        ({"branch_prob": [0.5, np.nan, 1, 1]}, r"\(s=1\), action a11 has a probability of nan"),
        ({"branch_prob": [0.5, 0.5, 1]}, r"branch_prob has shape \(3,\), not \(4,\)"),
        ({"branch_target": [0, 0, 1, 1]}, r"\(s=1\), action a11 has successor \(s=1\) twice"),
        ({"branch_target": [0, 2, 1, 1]}, r"branch_target holds 0..2, allowed is 0..1"),
        ({"branch_target": [0, -1, 1, 1]}, r"branch_target holds -1..1, allowed is 0..1"),
        ({"choice_action": [1, 1, 2]}, r"\(s=1\), action a12 is there twice"),
        ({"choice_action": [0, 1, 3]}, r"choice_action holds 0..3, allowed is 0..2"),
        ({"choice_reward": [5, np.inf, -1]}, r"\(s=1\), action a12 has reward inf"),
        ({"state_to_choice": [0, 3, 3]}, r"state \(s=2\) has no action"),
        ({"state_to_choice": [0, 2, 2]}, r"state_to_choice must rise from 0 to 3"),
        ({"choice_to_branch": [0, 3, 2, 4]}, r"choice_to_branch must rise from 0 to 4"),
        ({"choice_to_branch": [0, 2, 2, 4]}, r"\(s=1\), action a12 has no successor"),
        ({"initial": [0.5, 0.4]}, r"initial distribution sums to 0.9"),
        ({"initial": [np.nan, 1]}, r"initial distribution sums to nan"),
        ({"initial": [1.5, -0.5]}, r"initial distribution sums to 1.0"),
        ({"reachable": [False, True]}, r"initial state \(s=1\) is marked unreachable"),
        ({"reachable": [True, False]}, r"action a11 leads to \(s=2\), which is marked unreachable"),
        ({"valuations": [[7], [7]]}, r"states 0 and 1 are both \(s=7\)"),
        ({"action_names": ("a", "b", "a")}, r"action name 'a' is there twice"),
        (
            {"variable_names": ("s", "s"), "valuations": [[1, 1], [2, 2]]},
            r"variable name 's' is there twice",
        ),
        ({"labels": {"far": [True]}}, r"label 'far' has shape \(1,\), not \(2,\)"),
        ({"branch_reward": [5, 5, 10]}, r"branch_reward has shape \(3,\), not \(4,\)"),
        ({"branch_reward": [5, 6, 10, -1]}, r"\(s=1\), action a11: branch rewards average 5.5"),
    ],
)
def test_a_broken_invariant_is_named(changes: Mapping[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        replace(puterman_two_states(), **changes)


def test_arrays_cannot_be_written() -> None:
    mdp = pickle.loads(pickle.dumps(unreachable_tail()))
    for model in (mdp, unreachable_tail()):
        with pytest.raises(ValueError, match="read-only"):
            model.branch_prob[0] = 0.5
        with pytest.raises(ValueError, match="read-only"):
            model.labels["late"][0] = True


def test_pickling_keeps_the_fields_and_drops_what_is_derived() -> None:
    mdp = unreachable_tail()
    assert mdp.transitions.shape == (4, 4)
    copy = pickle.loads(pickle.dumps(mdp))
    assert set(copy.__dict__) == {declared.name for declared in fields(TabularMDP)}
    for declared in fields(TabularMDP):
        if declared.name == "labels":
            assert copy.labels.keys() == mdp.labels.keys()
            assert copy.labels["late"].tolist() == mdp.labels["late"].tolist()
        else:
            np.testing.assert_array_equal(getattr(copy, declared.name), getattr(mdp, declared.name))


def test_the_callers_array_stays_writable() -> None:
    initial = np.array([1.0, 0.0])
    replace(puterman_two_states(), initial=initial)
    initial[0] = 0.0
    assert initial.tolist() == [0, 0]


def test_restriction_drops_what_is_unreachable() -> None:
    mdp = unreachable_tail()
    assert mdp.reachable.tolist() == [True, True, False, False]
    small = restrict_to_reachable(mdp)
    assert small.valuations.tolist() == [[0], [1]]
    assert small.state_to_choice.tolist() == [0, 1, 3]
    assert small.choice_reward.tolist() == [1, 2, 0]
    assert small.branch_target.tolist() == [1, 0, 1, 1]
    assert small.labels["late"].tolist() == [False, True]
    assert small.branch_reward is None


def test_restriction_renumbers_states_in_their_order() -> None:
    mdp = make_mdp(
        {
            (0,): {},
            (1,): {"go": (0.5, {(3,): 1.0})},
            (2,): {"go": (0.0, {(0,): 1.0})},
            (3,): {"go": (1.5, {(1,): 0.5, (3,): 0.5})},
        },
        initial={(1,): 1.0},
    )
    small = restrict_to_reachable(replace(mdp, branch_reward=np.array([0.5, 0.0, 1.0, 2.0])))
    assert small.valuations.tolist() == [[1], [3]]
    assert small.branch_target.tolist() == [1, 0, 1]
    assert small.initial.tolist() == [1, 0]
    assert small.branch_reward is not None
    assert small.branch_reward.tolist() == [0.5, 1.0, 2.0]


def test_qualitative_sets_of_the_trap() -> None:
    # By hand: 0 and 1 may circle, so nothing forces them out, and leaving may lose.
    mdp = end_component_trap()
    won = mdp.labels["won"]
    assert attractor(mdp, won).tolist() == [False, False, True, False]
    assert surely_reaching(mdp, won).tolist() == [False, False, True, False]
    either = np.array([False, False, True, True])
    assert surely_reaching(mdp, either).all()
    assert attractor(mdp, either).tolist() == [False, False, True, True]


@pytest.mark.parametrize("seed", range(20))
def test_qualitative_sets_against_plain_fixed_points(seed: int) -> None:
    mdp = random_mdp(np.random.default_rng(seed), num_states=10)
    target = mdp.labels["target"]
    support = dense(mdp)[0] > 0
    inside = set(np.flatnonzero(target).tolist())
    for _ in range(mdp.num_states):
        inside |= {
            state
            for state in range(mdp.num_states)
            if all(
                set(np.flatnonzero(support[state, action])) & inside
                for action in np.flatnonzero(mdp.enabled[state])
            )
        }
    assert set(np.flatnonzero(attractor(mdp, target))) == inside

    outer = set(range(mdp.num_states))
    for _ in range(mdp.num_states):
        inner = set(np.flatnonzero(target).tolist())
        for _ in range(mdp.num_states):
            inner |= {
                state
                for state in outer
                for action in np.flatnonzero(mdp.enabled[state])
                if set(np.flatnonzero(support[state, action])) <= outer
                and set(np.flatnonzero(support[state, action])) & inner
            }
        outer = inner
    assert set(np.flatnonzero(surely_reaching(mdp, target))) == outer


def test_rows_are_matched_across_tables() -> None:
    table = np.array([[3, -1], [0, 7], [-2, 7]])
    rows = np.array([[-2, 7], [0, 0], [3, -1]])
    assert match_rows(rows, table).tolist() == [2, -1, 0]
    assert match_rows(rows, table[:0]).tolist() == [-1, -1, -1]


def test_row_keys_of_a_range_too_wide_for_one_integer() -> None:
    wide = np.array([[-(2**62), 2**62], [2**62, 5], [-(2**62), 2**62]])
    keys = row_keys(wide)[0]
    assert keys[0] == keys[2] != keys[1]
    assert match_rows(wide[:1], wide[1:]).tolist() == [1]


def test_row_keys_without_columns() -> None:
    assert row_keys(np.zeros((2, 0), dtype=np.int64))[0].tolist() == [0, 0]


@pytest.mark.parametrize(
    ("keys", "expected"), [([1, 2, 9], None), ([4, 1, 3], None), ([3, 1, 3], (0, 2)), ([], None)]
)
def test_first_repeat(keys: list[int], expected: tuple[int, int] | None) -> None:
    assert first_repeat(np.array(keys, dtype=np.int64)) == expected


def test_rows_of_a_compressed_array() -> None:
    pointers = pointers_of(np.array([2, 0, 3, 0]))
    values = np.array([4.0, 1.0, 2.0, 7.0, 7.0])
    assert pointers.tolist() == [0, 2, 2, 5, 5]
    assert row_best(values, pointers, maximise=True, empty=-1).tolist() == [4, -1, 7, -1]
    assert row_best(values, pointers, maximise=False).tolist() == [1, 0, 2, 0]
    assert ragged_indices(pointers, np.array([2, 1, 0])).tolist() == [2, 3, 4, 0, 1]
    assert ragged_indices(pointers, np.array([], dtype=np.int64)).tolist() == []
    row_of = np.array([0, 0, 2, 2, 2])
    assert first_match(values, np.array([1.0, 0, 7, 0]), row_of).tolist() == [1, -1, 3, -1]
