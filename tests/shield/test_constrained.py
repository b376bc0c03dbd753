"""The optimum within a threshold: closed forms, and a linear program over occupancies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.sparse import coo_array

from merap.mdp.model import Bools, TabularMDP
from merap.mdp.planning import optimum
from merap.mdp.reachability import bounded_reachability
from merap.shield.constrained import constrained_optimum
from tests.support.mdp_examples import make_mdp, random_mdp

HORIZON = 4

# Over the edge: 10, and a fall with 1/5. Around it: 4.
EDGE = make_mdp(
    {
        (0,): {"edge": (0.0, {(1,): 0.8, (2,): 0.2}), "around": (4.0, {(3,): 1.0})},
        (1,): {"edge": (10.0, {(3,): 1.0})},
        (2,): {"edge": (0.0, {(3,): 1.0})},
        (3,): {"edge": (0.0, {(3,): 1.0})},
    }
)
FALL = np.array([False, False, True, False])


@pytest.mark.parametrize(
    ("threshold", "expected"),
    [
        (0.0, 4.0),
        (0.05, 5.0),  # a quarter of the time over the edge, which is worth 8
        (0.2, 8.0),
        (1.0, 8.0),
    ],
)
def test_chance_uses_up_what_the_threshold_leaves(threshold: float, expected: float) -> None:
    assert constrained_optimum(EDGE, FALL, threshold, HORIZON) == pytest.approx(expected)


def test_where_the_threshold_cannot_be_kept_the_least_risk_counts() -> None:
    mdp = make_mdp(
        {
            (0,): {"a": (1.0, {(1,): 0.5, (2,): 0.5}), "b": (9.0, {(1,): 0.2, (2,): 0.8})},
            (1,): {"a": (0.0, {(1,): 1.0})},
            (2,): {"a": (0.0, {(2,): 1.0})},
        }
    )
    unsafe = np.array([False, False, True])
    for threshold in (0.0, 0.1, 0.5):
        assert constrained_optimum(mdp, unsafe, threshold, HORIZON) == pytest.approx(1.0)


def _by_linear_program(mdp: TabularMDP, unsafe: Bools, threshold: float) -> float:
    """Over occupancies x[t, f, c] of choices, f: whether a violation has happened."""
    num_states, num_choices = mdp.num_states, mdp.num_choices
    place = np.arange(HORIZON * 2 * num_choices).reshape(HORIZON, 2, num_choices)
    node = np.arange((HORIZON + 1) * 2 * num_states).reshape(HORIZON + 1, 2, num_states)
    choice, target, prob = mdp.branch_choice, mdp.branch_target, mdp.branch_prob
    row, column, value = [], [], []
    for t in range(HORIZON):
        for flag in range(2):
            row += [node[t, flag, mdp.choice_state], node[t + 1, flag | unsafe[target], target]]
            column += [place[t, flag], place[t, flag, choice]]
            value += [np.ones(num_choices), -prob]
    flow = coo_array(
        (np.concatenate(value), (np.concatenate(row), np.concatenate(column))), shape=(node.size, place.size)
    ).tocsr()
    begin = np.zeros(node.shape)
    begin[0, unsafe.astype(int), np.arange(num_states)] = mdp.initial
    inner = node[:-1].ravel()
    found = linprog(
        -np.tile(mdp.choice_reward, HORIZON * 2),
        A_eq=flow[inner],
        b_eq=begin.ravel()[inner],
        A_ub=-flow[node[-1, 1]].sum(axis=0)[np.newaxis],
        b_ub=[threshold],
    )
    assert found.status == 0
    return -float(found.fun)


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1.0))
@settings(max_examples=40, deadline=None)
def test_a_linear_program_agrees(seed: int, part: float) -> None:
    mdp = random_mdp(np.random.default_rng(seed), num_states=6)
    unsafe = mdp.labels["target"]
    least = float(mdp.initial @ bounded_reachability(mdp, unsafe, HORIZON, maximise=False))
    threshold = least + part * (1 - least)
    found = constrained_optimum(mdp, unsafe, threshold, HORIZON)
    assert found == pytest.approx(_by_linear_program(mdp, unsafe, threshold), abs=1e-6)
    assert found <= optimum(mdp, HORIZON) + 1e-9
