"""Robust risk: closed forms, Storm, enumeration of all policies and models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merap.errors import EngineError, ModelError
from merap.mdp.umb import write_umb
from merap.shield import fixpoint
from merap.shield.fixpoint import robust_risk
from merap.shield.models import model_sets
from tests.support.mdp_examples import random_mdp
from tests.support.shield_examples import enumerated_risk, make_sets, random_sets
from tests.support.storm_runs import storm_values

seeds = st.integers(0, 2**32 - 1)


def test_nature_may_keep_a_move_from_succeeding_but_gains_nothing_by_it() -> None:
    # State 0 stays or is decided by a fair coin: the least solution is 1/2, though every value in
    # [1/2, 1] solves the equations, so that iteration from above would stay at 1.
    sets = make_sets({0: {0: [{0: 1.0}, {1: 0.5, 2: 0.5}]}, 1: {0: [{1: 1.0}]}}, {2}, num_states=3)
    risk = robust_risk(sets)
    assert risk.of_states.tolist() == [0.5, 0.0, 1.0]
    assert risk.certain[:, 0].tolist() == [False, True, False]


def test_a_slip_of_unknown_size_counts_with_its_largest() -> None:
    # One step beside a hole with a slip of 0.1 or 0.3, then safety.
    sets = make_sets(
        {0: {0: [{1: 0.9, 2: 0.1}, {1: 0.7, 2: 0.3}], 1: [{0: 1.0}]}, 1: {0: [{1: 1.0}]}}, {2}, num_states=3
    )
    risk = robust_risk(sets)
    assert risk.of_actions[0].tolist() == [pytest.approx(0.3), 0.0]
    assert risk.of_states[0] == 0.0


def test_a_minute_risk_is_no_certainty() -> None:
    # 1e-200 twice in a row is 1e-400, which no double holds.
    sets = make_sets(
        {0: {0: [{1: 1e-200, 3: 1.0}]}, 1: {0: [{2: 1e-200, 3: 1.0}]}, 3: {0: [{3: 1.0}]}}, {2}, num_states=4
    )
    risk = robust_risk(sets)
    assert not risk.certain[0, 0]
    assert risk.of_actions[0, 0] > 0
    assert risk.certain[3, 0]


def test_an_action_that_may_be_disabled_is_not_relied_on() -> None:
    # Action 0 is safe but unsure, action 1 is sure and falls with 0.4.
    choices = {0: {0: [{1: 1.0}], 1: [{1: 0.6, 2: 0.4}]}, 1: {0: [{1: 1.0}]}}
    sure = robust_risk(make_sets(choices, {2}, num_states=3))
    unsure = robust_risk(make_sets(choices, {2}, num_states=3, unsure={(0, 0)}))
    neither = robust_risk(make_sets(choices, {2}, num_states=3, unsure={(0, 0), (0, 1)}))
    assert (sure.of_states[0], unsure.of_states[0]) == (0.0, pytest.approx(0.4))
    # One of the two is left; the worst is that it is action 1.
    assert neither.of_states[0] == pytest.approx(0.4)


@pytest.mark.parametrize("seed", range(12))
def test_storm_agrees_on_a_single_model(tmp_path: Path, seed: int) -> None:
    generator = np.random.default_rng(seed)
    mdp = random_mdp(generator, num_states=25, num_actions=4, num_branches=3, num_sinks=3)
    write_umb(mdp, tmp_path / "mdp.umb")
    storm = np.array(storm_values(tmp_path / "mdp.umb", 'Pmin=? [F "target"]'))
    sets = model_sets([mdp], mdp.labels["target"]).outcomes(np.ones(1, dtype=np.bool_))
    risk = robust_risk(sets, precision=1e-14)
    here = mdp.reachable
    np.testing.assert_allclose(risk.of_states[here], storm[here], atol=1e-9)
    assert np.array_equal(risk.of_states[here] == 0, storm[here] == 0)


@pytest.mark.parametrize("seed", range(25))
def test_enumeration_of_policies_and_models_agrees(seed: int) -> None:
    choices, sets = random_sets(np.random.default_rng(seed))
    risk = robust_risk(sets, precision=1e-14)
    expected = enumerated_risk(choices, sets.unsafe)
    np.testing.assert_allclose(risk.of_states, expected, atol=1e-9)
    assert np.array_equal(risk.of_states == 0, expected == 0)


@given(seeds, st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
@settings(max_examples=40, deadline=None)
def test_the_ends_of_an_interval_are_enough(seed: int, one: float, other: float, between: float) -> None:
    # A linear function is largest at a vertex (Nilim and El Ghaoui 2005): more members inside the
    # interval change nothing.
    low, high = sorted((one, other))
    inside = low + between * (high - low)
    generator = np.random.default_rng(seed)
    start, end = generator.uniform(0, 1, 2)

    def interval(*probabilities: float) -> list[dict[int, float]]:
        return [{1: 1 - prob, 3: prob} for prob in probabilities]

    base = {1: {0: [{2: 1 - start, 3: start}], 1: [{0: end, 3: 1 - end}]}, 2: {0: [{2: 1.0}]}}
    ends = make_sets({0: {0: interval(low, high)}, **base}, {3}, num_states=4)
    more = make_sets({0: {0: interval(low, inside, high)}, **base}, {3}, num_states=4)
    np.testing.assert_allclose(robust_risk(more).of_states, robust_risk(ends).of_states, atol=1e-8)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_more_models_never_lower_the_risk(seed: int) -> None:
    generator = np.random.default_rng(seed)
    models = [random_mdp(generator, num_states=8) for _ in range(4)]
    sets = model_sets(models, models[0].labels["target"])
    few = robust_risk(sets.outcomes(np.array([True, True, False, False])))
    all_ = robust_risk(sets.outcomes(np.ones(4, dtype=np.bool_)))
    possible = few.of_actions < 1
    assert np.all(all_.of_actions[possible] >= few.of_actions[possible] - 1e-8)


def test_what_does_not_converge_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    # Two states that lead to each other but for 1e-17, which 1 - 1e-17 doesn't show: no linear system
    # can be solved, and a sweep brings 1e-17.
    monkeypatch.setattr(fixpoint, "MAX_SWEEPS", 500)
    sets = make_sets({0: {0: [{1: 1.0, 2: 1e-17}]}, 1: {0: [{0: 1.0}]}}, {2}, num_states=3)
    assert 0 < robust_risk(sets).of_states[0] < 1e-10
    with pytest.raises(EngineError, match="risk still grows"):
        robust_risk(sets, precision=1e-20)


@pytest.mark.parametrize("leaving", [1e-5, 1e-8])
def test_a_loop_that_is_hardly_ever_left_is_left(monkeypatch: pytest.MonkeyPatch, leaving: float) -> None:
    # Left for a hole or for safety, in a ratio that nature picks: 3 to 1 at worst. Sweeps alone would
    # take some 1 / `leaving` of them.
    monkeypatch.setattr(fixpoint, "MAX_SWEEPS", 500)
    away = [{0: 1 - leaving, 1: leaving * share, 2: leaving * (1 - share)} for share in (0.5, 0.25)]
    sets = make_sets({0: {0: away}, 1: {0: [{1: 1.0}]}}, {2}, num_states=3)
    risk = robust_risk(sets, precision=1e-14)
    assert risk.of_states[0] == pytest.approx(0.75, abs=1e-6)


def test_outcomes_that_do_not_sum_to_one_are_refused() -> None:
    with pytest.raises(ModelError, match=r"state 0, action 1: the outcomes' probabilities sum to 0\.9"):
        make_sets({0: {1: [{0: 0.9}]}}, {1}, num_states=2)
