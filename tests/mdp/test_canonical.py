"""The canonical index: one numbering for all models of a case."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.alignment import align_actions, align_variables
from merap.mdp.canonical import canonicalise
from merap.mdp.comparison import compare
from merap.mdp.model import TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.mdp.umb import read_umb, write_umb
from tests.support.mdp_examples import SHIFTS, State, grid_cells, large_grid, make_mdp, whole_paper_grid
from tests.support.mdp_routes import assert_identical, shuffled

ACTIONS = ("stop", "up", "down", "left", "right")
VARIABLES = ("row", "col")


def canonical_grid(mdp: TabularMDP) -> TabularMDP:
    return canonicalise(mdp, grid_cells(), VARIABLES, ACTIONS)


def two_modes() -> TabularMDP:
    """A whole model made by hand: from (0, m0) both outcomes of `try` end the task."""
    return make_mdp(
        {
            (0, 0, 0): {
                "switch": (-1.0, {(0, 1, 0): 1.0}),
                "try": (2.0, {(1, 0, 1): 0.25, (0, 0, 1): 0.5, (0, 1, 0): 0.25}),
            },
            (1, 0, 1): {"end": (0.0, {(1, 0, 1): 1.0})},
            (0, 1, 0): {"try": (5.0, {(0, 1, 0): 1.0})},
            (0, 0, 1): {"end": (0.0, {(0, 0, 1): 1.0})},
        },
        variables=("loc", "mode", "done"),
        labels={"done": {(1, 0, 1), (0, 0, 1)}, "first": {(0, 0, 0), (0, 0, 1)}},
    )


BOTH = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])


def canonical_modes(mdp: TabularMDP, **changes: Any) -> TabularMDP:
    arguments: dict[str, Any] = {
        "valuations": BOTH,
        "variable_names": ("loc", "mode"),
        "action_names": ("try", "switch"),
    }
    return canonicalise(mdp, **(arguments | changes))


def test_two_modes_by_hand() -> None:
    mdp = canonical_modes(two_modes())
    assert mdp.valuations.tolist() == [[0, 0], [0, 1], [1, 0], [1, 1], [-1, -1]]
    assert mdp.action_names == ("try", "switch", "end")
    assert mdp.state_to_choice.tolist() == [0, 2, 3, 3, 3, 4]
    assert mdp.choice_action.tolist() == [0, 1, 0, 2]
    assert mdp.choice_reward.tolist() == [2, -1, 5, 0]
    assert mdp.choice_to_branch.tolist() == [0, 2, 3, 4, 5]
    assert mdp.branch_target.tolist() == [1, 4, 1, 1, 4]
    assert mdp.branch_prob.tolist() == [0.25, 0.75, 1, 1, 1]
    assert mdp.reachable.tolist() == [True, True, False, False, True]
    assert mdp.initial.tolist() == [1, 0, 0, 0, 0]
    assert mdp.labels.keys() == {"done", "first"}
    assert mdp.labels["done"].tolist() == [False] * 4 + [True]
    assert mdp.labels["first"].tolist() == [True] + [False] * 4
    assert mdp.branch_reward is None


def test_rewards_of_merged_branches_are_averaged() -> None:
    # The mean of `try` is a quarter of 8, half of 2 and a quarter of -4: 2. Of its branches into the
    # absorbing state, 0.25 with 8 and 0.5 with 2, it is 3 / 0.75 = 4.
    whole = replace(two_modes(), branch_reward=np.array([-1, 8, 2, -4, 0, 5, 0.0]))
    mdp = canonical_modes(whole)
    assert mdp.branch_reward is not None
    assert mdp.branch_reward.tolist() == [-4, 4, -1, 5, 0]
    assert mdp.choice_reward.tolist() == [2, -1, 5, 0]


def test_complete_initial_states_start_in_the_absorbing_one() -> None:
    mdp = canonical_modes(replace(two_modes(), initial=np.array([0.5, 0.2, 0.0, 0.3])))
    assert mdp.initial.tolist() == [0.5, 0, 0, 0, 0.5]


def test_the_paper_grid_has_82_states() -> None:
    blocked: list[State] = [(1, 2), (3, 2), (4, 1), (6, 1)]
    whole = whole_paper_grid(blocked=blocked)
    mdp = canonical_grid(whole)
    assert mdp.num_states == 82
    assert mdp.action_names == (*ACTIONS, "end")
    # As Storm builds it: 77 cells, and the goal or one beside it with done; one absorbing state here.
    assert whole.num_states == 77 + 5
    assert mdp.reachable.sum() == 77 + 1
    assert np.flatnonzero(~mdp.reachable).tolist() == [9 * row + col for row, col in blocked]
    assert mdp.enabled[mdp.reachable][:-1].tolist() == [[True] * 5 + [False]] * 77
    assert mdp.enabled[81].tolist() == [False] * 5 + [True]
    assert not mdp.enabled[~mdp.reachable].any()
    for discount in (1.0, 0.95):
        assert optimum(mdp, 18, discount) == optimum(whole, 18, discount)
        assert worst_value(mdp, 18, discount) == worst_value(whole, 18, discount)


def test_both_outcomes_of_a_slippery_goal_fold_into_one_branch() -> None:
    mdp = canonical_grid(whole_paper_grid(slip=0.1))
    goal = 9 * 4 + 4
    choices = range(mdp.state_to_choice[goal], mdp.state_to_choice[goal + 1])
    for choice in choices:
        part = slice(mdp.choice_to_branch[choice], mdp.choice_to_branch[choice + 1])
        assert mdp.branch_target[part].tolist() == [81]
        assert mdp.branch_prob[part].tolist() == [1]


@pytest.mark.parametrize("seed", range(5))
def test_equal_models_become_equal_arrays(seed: int) -> None:
    whole = whole_paper_grid(slip=0.1, blocked=[(1, 2), (3, 2)])
    other = shuffled(np.random.default_rng(seed), whole)
    compare(whole, other).require_same()
    assert_identical(canonical_grid(other), canonical_grid(whole))


def test_a_model_that_went_through_a_file(tmp_path: Path) -> None:
    whole = whole_paper_grid(slip=0.1)
    write_umb(whole, tmp_path / "mdp.umb")
    assert_identical(canonical_grid(read_umb(tmp_path / "mdp.umb")), canonical_grid(whole))


def test_unreachable_states_of_the_input_are_ignored() -> None:
    whole = make_mdp(
        {
            (0, 0): {"go": (1.0, {(0, 0): 1.0})},
            (5, 0): {"jump": (9.0, {(7, 0): 1.0})},
            (7, 0): {"end": (3.0, {(0, 0): 1.0})},
        },
        variables=("loc", "done"),
        labels={"done": set(), "far": {(5, 0)}},
    )
    mdp = canonicalise(whole, np.array([[0], [1]]), ("loc",), ("go",))
    assert mdp.state_to_choice.tolist() == [0, 1, 1, 2]
    assert mdp.reachable.tolist() == [True, False, False]
    assert not mdp.labels["far"].any()


@pytest.mark.slow
def test_a_base_without_an_objective_has_no_complete_states() -> None:
    size = 450
    grid = large_grid(size)
    mdp = canonicalise(grid, grid_cells(size), VARIABLES, tuple(SHIFTS), complete_label=None)
    assert mdp.num_states == size * size + 1
    assert not mdp.reachable[-1]
    assert mdp.enabled[-1].tolist() == [False] * 4 + [True]
    assert mdp.labels["done"].sum() == 1
    compare(mdp, grid).require_same()
    # Branches are ordered by target now: a second time changes nothing.
    again = canonicalise(mdp, grid_cells(size), VARIABLES, tuple(SHIFTS))
    assert_identical(again, replace(mdp, labels=again.labels))


def with_end_reward() -> TabularMDP:
    mdp = two_modes()
    return replace(mdp, choice_reward=np.where(mdp.choice_action == 2, 1.0, mdp.choice_reward))


@pytest.mark.parametrize(
    ("mdp", "changes", "message"),
    [
        (two_modes(), {"variable_names": ("loc", "phase")}, "variable 'mode' of the model is not one of"),
        (
            two_modes(),
            {"variable_names": ("loc", "mode", "speed"), "valuations": np.zeros((1, 3), dtype=np.int64)},
            "the model has no variable 'speed', only loc, mode, done",
        ),
        (two_modes(), {"variable_names": ("loc",), "valuations": BOTH[:, :1]}, "variable 'mode'"),
        (two_modes(), {"action_names": ("try",)}, r"action switch: the case declares only try"),
        (two_modes(), {"action_names": ("try", "switch", "end")}, "action 'end' is reserved"),
        (two_modes(), {"valuations": BOTH[:1]}, r"state \(loc=0, mode=1, done=0\) is not among the 1 states"),
        (two_modes(), {"complete_label": "over"}, "the model has no label 'over', only done, first"),
        (two_modes(), {"complete_label": None}, r"action end: not allowed in a state that is not complete"),
        (two_modes(), {"complete_label": "first"}, r"not allowed in a state that is complete"),
        (with_end_reward(), {}, r"\(loc=1, mode=0, done=1\), action end: has reward 1.0, it must be 0"),
        (
            replace(two_modes(), branch_target=np.array([2, 1, 3, 2, 3, 2, 3])),
            {},
            r"\(loc=1, mode=0, done=1\), action end: leaves the state",
        ),
        (
            replace(two_modes(), valuations=np.array([[0, 0, 0], [1, 0, 1], [0, 0, 2], [0, 0, 1]])),
            {},
            r"states \(loc=0, mode=0, done=0\) and \(loc=0, mode=0, done=2\), neither complete",
        ),
    ],
)
def test_what_does_not_fit_the_case_is_refused(
    mdp: TabularMDP, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        canonical_modes(mdp, **changes)


def test_alignment_by_name() -> None:
    mdp = two_modes()
    assert align_actions(mdp, ("end", "nap", "switch")).tolist() == [2, -1, 0]
    assert align_variables(mdp, ("done", "loc", "mode"))[1].tolist() == [1, 1, 0]
