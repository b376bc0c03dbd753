from __future__ import annotations

import numpy as np
import pytest

from merap.errors import ModelError
from merap.mdp.model import TabularMDP
from merap.mdp.simulation import simulator
from tests.support.mdp_examples import grid_cells, make_mdp, puterman_two_states, random_mdp, whole_paper_grid
from tests.support.placed import placed


def grid(goal: tuple[int, int] = (1, 2), slip: float = 0.0) -> TabularMDP:
    moves = ("stop", "up", "down", "left", "right")
    return placed(whole_paper_grid(3, goal, slip=slip), grid_cells(3), ("row", "col"), moves)


@pytest.mark.parametrize("seed", range(3))
def test_frequencies_of_branches_are_their_probabilities(seed: int) -> None:
    mdp = random_mdp(np.random.default_rng(seed))
    sim = simulator([mdp])
    draws = 20_000
    row = np.repeat(np.arange(mdp.num_choices), draws)
    branch = sim.successors.draw(row, np.random.default_rng(seed).random(len(row)))
    np.testing.assert_array_equal(mdp.branch_choice[branch], row)
    frequency = np.bincount(branch, minlength=mdp.num_branches) / draws
    error = np.sqrt(mdp.branch_prob * (1 - mdp.branch_prob) / draws)
    # 5 standard errors, since there are some 50 branches.
    assert np.all(np.abs(frequency - mdp.branch_prob) <= 5 * error)


def test_draws_at_the_edges_stay_in_their_row() -> None:
    mdp = random_mdp(np.random.default_rng(0))
    sim = simulator([mdp])
    rows = np.arange(mdp.num_choices)
    for uniform, entry in (
        (0.0, mdp.choice_to_branch[:-1]),
        (np.nextafter(1, 0), mdp.choice_to_branch[1:] - 1),
    ):
        drawn = sim.successors.draw(rows, np.full(len(rows), uniform))
        np.testing.assert_array_equal(drawn, entry)


def test_several_models_keep_apart() -> None:
    models = [grid(), grid((0, 1), slip=0.25), grid((2, 2))]
    sim = simulator(models)
    for n, model in enumerate(models):
        own = slice(n * model.num_states, (n + 1) * model.num_states)
        enabled = sim.choice[own] >= 0
        np.testing.assert_array_equal(enabled, model.enabled[:, :-1])
        np.testing.assert_array_equal(sim.completed[own], model.labels["done"])
        # The choices of a model on an index are in the order of state and action.
        choices = sim.choice[own][enabled]
        prob = model.transitions.toarray()[model.choice_action != model.num_actions - 1]
        for uniform in (0.1, 0.9):
            target = sim.target[sim.successors.draw(choices, np.full(len(choices), uniform))]
            assert np.all(prob[np.arange(len(choices)), target - n * model.num_states] > 0)
        assert sim.first_states(np.array([n]), np.array([0.5])).tolist() == [n * model.num_states + 2]


def test_end_is_no_action_but_other_models_keep_all_names() -> None:
    assert simulator([grid()]).action_names == ("stop", "up", "down", "left", "right")
    assert simulator([puterman_two_states()]).action_names == ("a11", "a12", "a21")
    assert not simulator([puterman_two_states()]).completed.any()


def test_rewards_are_those_of_branches_where_the_model_knows_them() -> None:
    mdp = puterman_two_states()
    np.testing.assert_array_equal(simulator([mdp]).reward, [5.0, 5.0, 10.0, -1.0])


def test_models_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ModelError, match="no model"):
        simulator([])
    with pytest.raises(ModelError, match="model 1 has actions"):
        simulator([grid(), puterman_two_states()])
    moves = ("stop", "up", "down", "left", "right")
    larger = placed(whole_paper_grid(4, (1, 2)), grid_cells(4), ("row", "col"), moves)
    with pytest.raises(ModelError, match="model 1 has other states"):
        simulator([grid(), larger])


def test_a_start_that_is_completed_is_refused() -> None:
    done = make_mdp({(0,): {"end": (0.0, {(0,): 1.0})}}, labels={"done": {(0,)}})
    with pytest.raises(ModelError, match=r"initial state \(s=0\) is completed already"):
        simulator([done])


def test_end_before_the_end_is_refused() -> None:
    early = make_mdp(
        {(0,): {"end": (0.0, {(1,): 1.0})}, (1,): {"end": (0.0, {(1,): 1.0})}}, labels={"done": {(1,)}}
    )
    with pytest.raises(ModelError, match=r"\(s=0\), action end: only a completed state"):
        simulator([early])


def test_one_label_done_is_not_enough_for_two_models() -> None:
    labelled = make_mdp({(0,): {"go": (0.0, {(0,): 1.0})}, (1,): {}}, labels={"done": {(1,)}})
    endless = make_mdp({(0,): {"go": (0.0, {(0,): 1.0})}, (1,): {}})
    with pytest.raises(ModelError, match="only one of model 0 and model 1"):
        simulator([labelled, endless])
