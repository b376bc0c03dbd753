from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

from merap.errors import InputError
from merap.mdp.gymnasium_import import import_gymnasium
from merap.mdp.planning import backward_induction

SHIFTS = {"left": (0, -1), "west": (0, -1), "right": (0, 1), "east": (0, 1)}
SHIFTS |= {"up": (-1, 0), "north": (-1, 0), "down": (1, 0), "south": (1, 0)}


def test_factors_of_the_lake() -> None:
    mdp = import_gymnasium("FrozenLake-v1", desc=["SFH", "FFG"])
    assert mdp.variable_names == ("row", "col")
    assert mdp.valuations.tolist() == [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2], [-1, -1]]
    assert mdp.action_names == ("left", "down", "right", "up", "end")
    assert np.flatnonzero(mdp.labels["goal"]).tolist() == [5]
    assert np.flatnonzero(mdp.labels["hole"]).tolist() == [2]
    # Where an episode has ended nobody is: these cells fold into the last state.
    assert np.flatnonzero(~mdp.reachable).tolist() == [2, 5]


def test_factors_of_the_taxi_are_those_that_it_decodes() -> None:
    env = gymnasium.make("Taxi-v4").unwrapped
    mdp = import_gymnasium(env)
    assert mdp.variable_names == ("taxi_row", "taxi_col", "passenger", "destination")
    decoded = [tuple(env.decode(state)) for state in range(500)]  # type: ignore[attr-defined]
    assert [tuple(row) for row in mdp.valuations[:-1].tolist()] == decoded
    # Delivered: the taxi stands where the passenger and the destination are.
    assert sorted(np.flatnonzero(mdp.labels["goal"]).tolist()) == [0, 85, 410, 475]
    # 400 states are seen within an episode, says Gymnasium's documentation.
    assert mdp.reachable.sum() == 401


def test_labels_and_factors_of_the_cliff() -> None:
    mdp = import_gymnasium("CliffWalking-v1")
    rows, cols = mdp.valuations.T
    np.testing.assert_array_equal(mdp.labels["cliff"], (rows == 3) & (cols >= 1) & (cols <= 10))
    np.testing.assert_array_equal(mdp.labels["goal"], (rows == 3) & (cols == 11))
    # Sutton and Barto 2018, Example 6.6: along the cliff 13 steps, each costs 1.
    assert backward_induction(mdp, 20).value == -13


@pytest.mark.parametrize(
    ("env_id", "kwargs"),
    [("FrozenLake-v1", {"is_slippery": False}), ("Taxi-v4", {}), ("CliffWalking-v1", {})],
)
def test_moves_go_where_their_names_say(env_id: str, kwargs: dict[str, Any]) -> None:
    mdp = import_gymnasium(env_id, **kwargs)
    going = mdp.branch_target != mdp.num_states - 1
    moved = (mdp.valuations[mdp.branch_target] - mdp.valuations[mdp.choice_state])[:, :2]
    moves = SHIFTS.keys() & set(mdp.action_names)
    assert len(moves) == 4
    for move in moves:
        taken = going & (mdp.choice_action == mdp.action_names.index(move))
        shift, count = np.unique(moved[taken], axis=0, return_counts=True)
        # Most moves succeed; one that fails leaves the place or leads back from the cliff.
        assert tuple(shift[count.argmax()]) == SHIFTS[move]


def test_a_table_that_does_not_tell_everything_is_refused() -> None:
    with pytest.raises(InputError, match="fickle_passenger"):
        import_gymnasium("Taxi-v4", fickle_passenger=True)
