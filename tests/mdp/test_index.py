"""The index of a family: one numbering for all of its members."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.alignment import align_actions, align_variables
from merap.mdp.comparison import compare
from merap.mdp.index import FamilyIndex, carried, new_index
from merap.mdp.model import TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.mdp.umb import read_umb, write_umb
from tests.support.mdp_examples import State, grid_cells, make_mdp, whole_paper_grid
from tests.support.mdp_routes import assert_identical, shuffled

ACTIONS = ("stop", "up", "down", "left", "right")
NOTHING: frozenset[str] = frozenset()
GOAL = frozenset({"goal"})
BOTH = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])


def grid_index() -> FamilyIndex:
    return new_index(("row", "col"), ACTIONS, grid_cells(), [NOTHING, GOAL])


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
        labels={"done": {(1, 0, 1), (0, 0, 1)}, "first": {(0, 0, 0)}},
    )


def modes_index(**changes: Any) -> FamilyIndex:
    arguments: dict[str, Any] = {
        "valuations": BOTH,
        "variable_names": ("loc", "mode"),
        "actions": ("try", "switch"),
        "label_sets": [NOTHING],
    }
    return new_index(**(arguments | changes))


def test_two_modes_by_hand() -> None:
    mdp = modes_index().place(two_modes())
    assert mdp.valuations[1:].tolist() == BOTH.tolist()
    assert mdp.action_names == ("try", "switch", "end")
    assert mdp.state_to_choice.tolist() == [0, 1, 3, 4, 4, 4]
    assert mdp.choice_action.tolist() == [2, 0, 1, 0]
    assert mdp.choice_reward.tolist() == [0, 2, -1, 5]
    assert mdp.choice_to_branch.tolist() == [0, 1, 3, 4, 5]
    assert mdp.branch_target.tolist() == [0, 0, 2, 2, 2]
    assert mdp.branch_prob.tolist() == [1, 0.75, 0.25, 1, 1]
    assert mdp.reachable.tolist() == [True, True, True, False, False]
    assert mdp.initial.tolist() == [0, 1, 0, 0, 0]
    assert mdp.labels.keys() == {"done", "first"}
    assert mdp.labels["done"].tolist() == [True] + [False] * 4
    assert mdp.labels["first"].tolist() == [False, True, False, False, False]
    assert mdp.branch_reward is None


def test_rewards_of_merged_branches_are_averaged() -> None:
    # The mean of `try` is a quarter of 8, half of 2 and a quarter of -4: 2. Of its branches into the
    # completed state, 0.25 with 8 and 0.5 with 2, it is 3 / 0.75 = 4.
    whole = replace(two_modes(), branch_reward=np.array([-1, 8, 2, -4, 0, 5, 0.0]))
    mdp = modes_index().place(whole)
    assert mdp.branch_reward is not None
    assert mdp.branch_reward.tolist() == [0, 4, -4, -1, 5]
    assert mdp.choice_reward.tolist() == [0, 2, -1, 5]


def test_complete_states_are_one_for_each_set_of_labels() -> None:
    labels = {**two_modes().labels, "goal": np.array([False, True, False, False])}
    whole = replace(two_modes(), labels=labels)
    index = new_index(("loc", "mode"), ("try", "switch")).extended(whole)
    assert index.completed == {NOTHING: 0, GOAL: 1}
    assert index.valuations[2:].tolist() == [[0, 0], [0, 1]]
    mdp = index.place(whole)
    assert mdp.labels["done"].tolist() == [True, True, False, False]
    assert mdp.labels["goal"].tolist() == [False, True, False, False]
    assert mdp.branch_target.tolist() == [0, 1, 0, 1, 3, 3, 3]
    assert mdp.branch_prob.tolist() == [1, 1, 0.5, 0.25, 0.25, 1, 1]


def test_a_completed_state_is_none_of_the_values_that_variables_have() -> None:
    # -1 is a value of the variable here, and the state with it is not complete
    whole = make_mdp(
        {
            (-1, 0): {"go": (1.0, {(-1, 1): 1.0})},
            (-1, 1): {"end": (0.0, {(-1, 1): 1.0})},
        },
        variables=("level", "done"),
        labels={"done": {(-1, 1)}},
    )
    index = new_index(("level",), ("go",)).extended(whole)
    assert index.is_completed.tolist() == [True, False]
    assert index.valuations[1].tolist() == [-1]
    assert index.valuations[0, 0] < -1
    assert index.place(whole).branch_target.tolist() == [0, 0]


def test_a_number_never_changes_when_states_are_added() -> None:
    first = new_index(("loc", "mode"), ("try", "switch"), BOTH[2:], [NOTHING])
    goal = {**two_modes().labels, "goal": np.array([False, True, False, False])}
    second = first.extended(replace(two_modes(), labels=goal))
    # before: completed, (1, 0), (1, 1); then the completed one at the goal, (0, 0) and (0, 1)
    assert second.completed == {NOTHING: 0, GOAL: 3}
    assert second.valuations[[1, 2, 4, 5]].tolist() == [[1, 0], [1, 1], [0, 0], [0, 1]]
    assert second.number(two_modes()).tolist() == [4, 0, 5, 0]
    assert second.extended(two_modes()).completed == second.completed
    assert second.extended(two_modes()).valuations.tolist() == second.valuations.tolist()


def test_valuations_can_be_added_alone() -> None:
    index = modes_index(valuations=BOTH[:1]).with_valuations(np.array([[1, 1], [0, 1], [0, 0], [1, 1]]))
    assert index.valuations[1:].tolist() == [[0, 0], [0, 1], [1, 1]]


def test_members_of_any_size_share_an_index() -> None:
    small, large = whole_paper_grid(3, (1, 1)), whole_paper_grid(4, (2, 3))
    actions = tuple(name for name in small.action_names if name != "end")
    index = new_index(("row", "col"), actions).extended(small, large)
    placed = [index.place(small), index.place(large)]
    assert [int(one.reachable.sum()) for one in placed] == [9 + 2, 16 + 2]
    for whole, one in zip((small, large), placed, strict=True):
        assert optimum(one, 18) == optimum(whole, 18)
        assert np.array_equal(one.valuations, index.valuations)


def test_a_placed_model_can_be_placed_again() -> None:
    index = grid_index()
    once = index.place(whole_paper_grid(slip=0.1))
    assert_identical(index.place(once), once)


def test_labels_that_a_model_lacks_do_not_matter() -> None:
    # two_modes() does not say where the goal is
    index = modes_index(label_sets=[GOAL])
    assert index.number(two_modes()).tolist() == [1, 0, 2, 0]
    assert index.extended(two_modes()).num_states == index.num_states


def test_tables_are_carried_from_one_index_to_another() -> None:
    source = new_index(("loc",), ("go",), np.array([[3], [5]]), [NOTHING])
    target = new_index(("loc",), ("go",), np.array([[5], [4], [3]]), [NOTHING, GOAL])
    table = np.array([[0.5], [0.3], [0.1]])
    found = carried(table, source, target, -1.0)
    # a completed state at the goal is any completed state where labels are not known
    assert found.tolist() == [[0.5], [0.5], [0.1], [-1], [0.3]]
    assert carried(np.stack([found, found]), target, source, -1.0).tolist() == [table.tolist()] * 2
    assert carried(table, source, new_index(("loc",), ("go",)), -1.0).shape == (0, 1)


def test_complete_initial_states_start_in_the_completed_one() -> None:
    mdp = modes_index().place(replace(two_modes(), initial=np.array([0.5, 0.2, 0.0, 0.3])))
    assert mdp.initial.tolist() == [0.5, 0.5, 0, 0, 0]


def test_the_paper_grid() -> None:
    blocked: list[State] = [(1, 2), (3, 2), (4, 1), (6, 1)]
    whole = whole_paper_grid(blocked=blocked)
    mdp = grid_index().place(whole)
    assert mdp.num_states == 2 + 81
    assert mdp.action_names == (*ACTIONS, "end")
    # As Storm builds it: 77 cells, and the goal or one beside it with done.
    assert whole.num_states == 77 + 5
    assert np.flatnonzero(~mdp.reachable[2:]).tolist() == [9 * row + col for row, col in blocked]
    assert mdp.enabled[2:][mdp.reachable[2:]].tolist() == [[True] * 5 + [False]] * 77
    assert mdp.enabled[:2].tolist() == [[False] * 5 + [True]] * 2
    for discount in (1.0, 0.95):
        assert optimum(mdp, 18, discount) == optimum(whole, 18, discount)
        assert worst_value(mdp, 18, discount) == worst_value(whole, 18, discount)


@pytest.mark.parametrize("seed", range(5))
def test_equal_models_become_equal_arrays(seed: int) -> None:
    whole = whole_paper_grid(slip=0.1, blocked=[(1, 2), (3, 2)])
    other = shuffled(np.random.default_rng(seed), whole)
    compare(whole, other).require_same()
    assert_identical(grid_index().place(other), grid_index().place(whole))
    assert grid_index().extended(other).num_states == grid_index().num_states


def test_a_model_that_went_through_a_file(tmp_path: Path) -> None:
    whole = whole_paper_grid(slip=0.1)
    write_umb(whole, tmp_path / "mdp.umb")
    assert_identical(grid_index().place(read_umb(tmp_path / "mdp.umb")), grid_index().place(whole))


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
    index = new_index(("loc",), ("go",)).extended(whole)
    assert (index.completed, index.valuations.tolist()) == ({}, [[0]])
    mdp = index.place(whole)
    assert mdp.state_to_choice.tolist() == [0, 1]
    assert not mdp.labels["far"].any()
    assert not mdp.labels["done"].any()


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
        (two_modes(), {"variable_names": ("loc",), "valuations": BOTH[:2, 1:]}, "variable 'mode'"),
        (two_modes(), {"actions": ("try",)}, r"action switch: the case declares only try"),
        (two_modes(), {"actions": ("try", "switch", "end")}, "action 'end' is reserved"),
        (two_modes(), {"valuations": BOTH[:1]}, r"state \(loc=0, mode=1, done=0\) is not among the 1 states"),
        (
            replace(two_modes(), labels={**two_modes().labels, "goal": np.zeros(4, dtype=np.bool_)}),
            {"label_sets": [GOAL]},
            "no completed state with the labels: none",
        ),
        (
            replace(two_modes(), labels={"first": two_modes().labels["first"]}),
            {},
            "action end: not allowed in a state that is not complete",
        ),
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
        (
            replace(two_modes(), labels={"done": np.array([False, True, False, False])}),
            {},
            r"\(loc=0, mode=0, done=1\), action end: not allowed in a state that is not complete",
        ),
        (
            replace(two_modes(), labels={"done": np.array([True, True, False, True])}),
            {},
            r"action switch: not allowed in a state that is complete",
        ),
    ],
)
def test_what_does_not_fit_the_family_is_refused(
    mdp: TabularMDP, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        modes_index(**changes).place(mdp)


def test_alignment_by_name() -> None:
    mdp = two_modes()
    assert align_actions(mdp, ("end", "nap", "switch")).tolist() == [2, -1, 0]
    assert align_variables(mdp, ("done", "loc", "mode"))[1].tolist() == [1, 1, 0]
