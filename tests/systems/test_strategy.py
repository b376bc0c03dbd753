from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from merap.mdp.model import Bools, Floats
from merap.systems.strategy import draw_action

JUST_BELOW_1 = math.nextafter(1.0, 0.0)
ALL = np.ones(3, dtype=np.bool_)


@pytest.mark.parametrize(
    ("uniform", "action"),
    # cumulated: 0.25, 0.25, 1
    [(0.0, 0), (0.2499, 0), (0.25, 2), (JUST_BELOW_1, 2)],
)
def test_an_action_is_drawn_by_inversion(uniform: float, action: int) -> None:
    assert draw_action(np.array([0.25, 0.0, 0.75]), ALL, uniform) == action


def test_what_is_not_allowed_is_shared_out_in_proportion() -> None:
    # 0.2 and 0.6 are left: a quarter and three quarters
    shares, allowed = np.array([0.2, 0.2, 0.6]), np.array([True, False, True])
    assert [draw_action(shares, allowed, u) for u in (0.0, 0.24, 0.26, 0.99)] == [0, 0, 2, 2]


def test_where_the_policy_has_nothing_left_allowed_actions_are_equal() -> None:
    shares, allowed = np.array([1.0, 0.0, 0.0]), np.array([False, True, True])
    assert [draw_action(shares, allowed, u) for u in (0.0, 0.49, 0.51, JUST_BELOW_1)] == [1, 1, 2, 2]


@pytest.mark.slow
@given(
    shares=hnp.arrays(np.float64, 5, elements=st.floats(0, 1)),
    allowed=hnp.arrays(np.bool_, 5).filter(np.any),
    uniform=st.floats(0, 1, exclude_max=True),
)
def test_an_allowed_action_comes_out_whatever_the_numbers(
    shares: Floats, allowed: Bools, uniform: float
) -> None:
    action = draw_action(shares, allowed, uniform)
    assert allowed[action]
    assert shares[action] > 0 or not (shares * allowed).any()
