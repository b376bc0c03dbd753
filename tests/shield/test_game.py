"""Policy iteration for robust risk: enumeration of all choices, sweeps, and what would mislead it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.mdp.model import Floats
from merap.shield.fixpoint import choice_risk, state_risk
from merap.shield.game import make_game, solve
from merap.shield.outcomes import OutcomeSets
from tests.support.shield_examples import enumerated_risk, make_sets, random_sets

seeds = st.integers(0, 2**32 - 1)


def _solved(sets: OutcomeSets, values: Floats) -> Floats:
    found = solve(make_game(sets), values)
    assert found is not None
    return found


def _swept(sets: OutcomeSets, sweeps: int) -> Floats:
    values = sets.unsafe.astype(np.float64)
    for _ in range(sweeps):
        values = state_risk(sets, choice_risk(sets, values))
    return values


@given(seeds, st.integers(0, 20))
@settings(max_examples=100, deadline=None)
def test_enumeration_of_policies_and_models_agrees(seed: int, sweeps: int) -> None:
    choices, sets = random_sets(np.random.default_rng(seed))
    found = _solved(sets, _swept(sets, sweeps))
    np.testing.assert_allclose(found, enumerated_risk(choices, sets.unsafe), atol=1e-9)


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_sweeps_agree_from_any_beginning(seed: int) -> None:
    # Some actions may be disabled; nature and the player begin with the best for random values.
    generator = np.random.default_rng(seed)
    _, sets = random_sets(generator, num_states=7, num_actions=3)
    sets = replace(sets, sure=generator.random(len(sets.sure)) < 0.7)
    found = _solved(sets, generator.random(sets.num_states))
    swept = _swept(sets, 500)
    assert np.all(swept <= found + 1e-9)  # sweeps from 0 never exceed the least solution
    np.testing.assert_allclose(state_risk(sets, choice_risk(sets, found)), found, atol=1e-12)
    still_rising = np.abs(state_risk(sets, choice_risk(sets, swept)) - swept).max() > 1e-13
    assert still_rising or np.allclose(found, swept, atol=1e-7)


def test_a_solution_that_is_not_the_least_is_not_taken_for_it() -> None:
    # Action 0 risks 3/10 unless nature stays, action 1 risks 1/2. Every value in [3/10, 1/2] solves the
    # equations, and 1/2 is what action 1 with a nature that stays comes to.
    sets = make_sets(
        {
            0: {0: [{0: 1.0}, {1: 0.7, 2: 0.3}], 1: [{1: 0.5, 2: 0.5}]},
            1: {0: [{1: 1.0}]},
        },
        {2},
        num_states=3,
    )
    for begun in (0.0, 0.3, 0.5, 1.0):
        assert np.isclose(_solved(sets, np.array([begun, 0.0, 1.0]))[0], 0.3)


def test_a_loop_that_numbers_do_not_show_to_be_left_is_not_solved() -> None:
    # 1 - 1e-17 is 1 in doubles, so that the linear system is singular.
    sets = make_sets({0: {0: [{1: 1.0, 2: 1e-17}]}, 1: {0: [{0: 1.0}]}}, {2}, num_states=3)
    assert solve(make_game(sets), np.array([0.0, 0.0, 1.0])) is None


def test_without_unsafe_states_nothing_is_at_risk() -> None:
    sets = make_sets({0: {0: [{0: 1.0}]}}, set(), num_states=1)
    assert _solved(sets, np.zeros(1)).tolist() == [0.0]


def test_nowhere_to_act() -> None:
    sets = make_sets({0: {0: [{0: 1.0}]}}, {0}, num_states=1)
    assert _solved(sets, np.ones(1)).tolist() == [1.0]
