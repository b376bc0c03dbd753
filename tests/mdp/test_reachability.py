"""Reachability probabilities: closed forms, textbook, Storm, models that fool naive iteration."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from merap.errors import EngineError
from merap.mdp.end_components import maximal_end_components
from merap.mdp.reachability import bounded_reachability, reachability
from merap.mdp.umb import write_umb
from tests.support.mdp_examples import (
    end_component_trap,
    gambler,
    large_grid,
    make_mdp,
    random_mdp,
    whole_paper_grid,
)
from tests.support.storm_runs import storm_values


@pytest.mark.slow
def test_bold_play_of_the_gambler() -> None:
    # Bold play is optimal below even odds (Dubins and Savage): p, p^2, p + (1 - p) p, and for
    # 20 -> 40 -> 80 -> 60 -> 20 the geometric sum of going round.
    mdp = gambler(0.4)
    bounds = reachability(mdp, mdp.labels["won"])
    expected = {50: 0.4, 25: 0.16, 75: 0.64, 20: 0.16 * 0.64 / (1 - 0.16 * 0.36), 0: 0.0, 100: 1.0}
    for capital, probability in expected.items():
        assert bounds.middle[capital] == pytest.approx(probability, abs=1e-9)
    assert np.all(bounds.upper - bounds.lower <= 1e-9)


def test_timid_play_ruins_the_gambler() -> None:
    # The least chance to be ruined is one minus the greatest chance to win: every game ends.
    mdp = gambler(0.4)
    won = reachability(mdp, mdp.labels["won"]).middle
    ruined = reachability(mdp, mdp.labels["lost"], maximise=False).middle
    np.testing.assert_allclose(won + ruined, 1, atol=1e-9)


def test_an_end_component_does_not_hide_the_upper_bound() -> None:
    mdp = end_component_trap()
    best = reachability(mdp, mdp.labels["won"])
    assert best.upper.tolist() == best.lower.tolist() == [0.5, 0.5, 1, 0]
    assert reachability(mdp, mdp.labels["won"], maximise=False).upper.tolist() == [0, 0, 1, 0]


def test_certainty_comes_from_the_graph() -> None:
    # Leaving takes 10^12 attempts on average: iteration alone would not see the 1.
    mdp = make_mdp(
        {(0,): {"try": (0.0, {(0,): 1 - 1e-12, (1,): 1e-12})}, (1,): {"stay": (0.0, {(1,): 1.0})}},
        labels={"out": {(1,)}},
    )
    for maximise in (True, False):
        bounds = reachability(mdp, mdp.labels["out"], maximise=maximise)
        assert bounds.lower.tolist() == [1, 1]


def test_states_without_choices_reach_nothing_else() -> None:
    mdp = make_mdp({(0,): {"stay": (0.0, {(0,): 1.0})}, (1,): {}, (2,): {"go": (0.0, {(1,): 1.0})}})
    target = np.array([False, True, False])
    assert reachability(mdp, target).lower.tolist() == [0, 1, 1]
    assert reachability(mdp, target, maximise=False).lower.tolist() == [0, 1, 1]
    assert bounded_reachability(mdp, np.array([True, False, False]), 3).tolist() == [1, 0, 0]


@pytest.mark.parametrize("seed", range(15))
@pytest.mark.parametrize("maximise", [True, False])
def test_storm_agrees(tmp_path: Path, seed: int, maximise: bool) -> None:
    mdp = random_mdp(np.random.default_rng(seed), num_states=25, num_actions=4, num_branches=3, num_sinks=3)
    write_umb(mdp, tmp_path / "mdp.umb")
    target = mdp.labels["target"]
    which = "max" if maximise else "min"
    bounds = reachability(mdp, target, maximise=maximise)
    storm = storm_values(tmp_path / "mdp.umb", f'P{which}=? [F "target"]')
    np.testing.assert_allclose(bounds.middle, storm, atol=2e-9)
    storm_bounded = storm_values(tmp_path / "mdp.umb", f'P{which}=? [F<=5 "target"]')
    np.testing.assert_allclose(
        bounded_reachability(mdp, target, 5, maximise=maximise), storm_bounded, atol=1e-12
    )


def test_the_goal_of_the_paper_grid_in_time() -> None:
    # 8 moves, each failing with 0.1: no failure in 8 steps, at most one in 9.
    mdp = whole_paper_grid(goal=(4, 4), slip=0.1)
    goal = mdp.labels["goal"]
    start = int(np.flatnonzero(mdp.initial)[0])
    assert bounded_reachability(mdp, goal, 7)[start] == 0
    assert bounded_reachability(mdp, goal, 8)[start] == pytest.approx(0.9**8, abs=1e-12)
    assert bounded_reachability(mdp, goal, 9)[start] == pytest.approx(0.9**8 + 8 * 0.1 * 0.9**8, abs=1e-12)
    assert reachability(mdp, goal).lower[start] == 1
    assert reachability(mdp, goal, maximise=False).upper[start] == 0


def test_giving_up_is_an_error() -> None:
    mdp = gambler(0.4)
    with pytest.raises(EngineError, match=r"only known up to .* after 3 sweeps"):
        reachability(mdp, mdp.labels["won"], max_sweeps=3)


def test_end_components_of_the_trap() -> None:
    component, inner = maximal_end_components(end_component_trap(), np.ones(4, dtype=np.bool_))
    assert component[0] == component[1] >= 0
    assert len({component[0], component[2], component[3]}) == 3
    assert inner.tolist() == [True, True, False, True, True]
    # Without state 0 the circle is broken: state 1 alone has no choice that stays.
    component, inner = maximal_end_components(end_component_trap(), np.array([False, True, True, False]))
    assert component.tolist() == [-1, -1, 0, -1]
    assert inner.tolist() == [False, False, False, True, False]


@pytest.mark.parametrize("seed", range(15))
def test_end_components_by_their_definition(seed: int) -> None:
    # An end component is a set with choices that stay in it and connect it; the maximal ones
    # are the largest among all sets of states.
    size = 6
    mdp = random_mdp(np.random.default_rng(seed), num_states=size, num_branches=2)
    component, inner = maximal_end_components(mdp, np.ones(size, dtype=np.bool_))
    support: list[set[int]] = [
        set(mdp.branch_target[slice(*mdp.choice_to_branch[choice : choice + 2])].tolist())
        for choice in range(mdp.num_choices)
    ]
    found: list[set[int]] = []
    for count in range(size, 0, -1):
        for members in map(set, combinations(range(size), count)):
            edges = np.eye(size, dtype=np.int64)
            for choice, state in enumerate(mdp.choice_state.tolist()):
                if state in members and support[choice] <= members:
                    edges[state, list(support[choice])] += 1
            moves = (edges - np.eye(size, dtype=np.int64)).sum(axis=1)[list(members)]
            connected = np.linalg.matrix_power(edges, size)[np.ix_(list(members), list(members))]
            if moves.all() and connected.all() and not any(members <= larger for larger in found):
                found.append(members)
    by_number = [set(np.flatnonzero(component == number)) for number in range(component.max() + 1)]
    assert sorted(map(sorted, by_number)) == sorted(map(sorted, found))
    for choice, state in enumerate(mdp.choice_state.tolist()):
        home = next((members for members in found if state in members), set())
        assert inner[choice] == (state in home and support[choice] <= home)


def test_a_large_model_is_checked() -> None:
    mdp = large_grid(450)
    corner = mdp.labels["corner"]
    assert reachability(mdp, corner).lower.min() == 1
    assert reachability(mdp, corner, maximise=False).upper[0] == 0
