from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from merap.belief.model import mean_model, tabular
from merap.belief.outside import Outside
from merap.belief.posterior import prior_belief
from merap.belief.space import hypothesis_space
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.errors import InputError
from merap.families.models import built
from merap.mdp.comparison import compare
from merap.mdp.model import TabularMDP
from merap.systems.slip import slipping_model
from tests.support.grid_tasks import grid_model, grid_task
from tests.support.hand_made import cells, graph_combination, grid_combination
from tests.support.placed import told_by_done

RUNNING = "models/running-example"
SLIP = 0.1


def believed(case: DeclaredCase, environment: int, capability: int, slip: float) -> TabularMDP:
    """What a belief that is certain of a combination and a slip takes the domain to be."""
    space = hypothesis_space(case, Outside(slips=(slip,)))
    belief = prior_belief(space)
    dynamics = np.full_like(belief.dynamics, -np.inf)
    dynamics[environment, capability, 1] = 0.0
    objective = np.full_like(belief.objective, -np.inf)
    objective[0, 0] = 0.0
    certain = replace(belief, dynamics=dynamics, objective=objective)
    return tabular(space, mean_model(space, certain), space.initial)


def test_without_slip_it_is_the_model_that_storm_builds() -> None:
    met = load_declared_case(RUNNING).system("met")
    compare(slipping_model(met, 0.0), built(met)).require_same()


def test_the_grid_that_slips_is_the_one_made_by_hand() -> None:
    """`grid_tasks` is independent of all code here: its slip is written into the branches."""
    combination = grid_combination(blocked=cells((0, 3), (2, 2)), goal=(4, 4))
    by_hand = grid_model(grid_task((4, 4), [(0, 3), (2, 2)]), slip=SLIP)
    by_hand = replace(
        by_hand,
        valuations=np.column_stack([by_hand.valuations, [*[0] * 81, -1]]),
        variable_names=("row", "col", "mode"),
    )
    found = slipping_model(combination, SLIP)
    assert set(found.labels) == {"done", "goal"}
    compare(told_by_done(found), by_hand).require_same()


@pytest.mark.parametrize(("environment", "capability"), [(0, 0), (2, 1)])
def test_the_belief_means_the_same_by_slip(environment: int, capability: int) -> None:
    """Locations, modes, innate actions, rewards of successors: the running example has them all."""
    case = load_declared_case(RUNNING)
    found = slipping_model(case.combine(environment, capability, 0), SLIP)
    of_belief = believed(case, environment, capability, SLIP)
    compare(told_by_done(found), of_belief).require_same()


def test_an_action_that_ends_the_task_ends_it_when_it_slips_too() -> None:
    model = slipping_model(grid_combination(goal=(0, 0)), SLIP)
    at_goal = told_by_done(model)
    (start,) = np.flatnonzero(at_goal.initial)
    choices = slice(*at_goal.state_to_choice[[start, start + 1]])
    # every action taken in the goal leads to the completed state, the first one, with certainty
    assert at_goal.transitions[choices].todense()[:, 0].tolist() == [1.0] * 5


def test_a_slip_in_the_middle_of_a_scan_keeps_the_mode() -> None:
    """`measure` succeeds with 9/10: 0.9 * 0.9 = 0.81 with a slip of 0.1."""
    model = slipping_model(graph_combination(), SLIP)
    measure = model.action_names.index("measure")
    choice = np.flatnonzero((model.choice_action == measure) & (model.choice_state == 1))[0]
    row = model.transitions[[choice]].todense()[0]
    assert row[1] == pytest.approx(0.19)  # still scanning in S
    assert row[2] == pytest.approx(0.81)


@pytest.mark.parametrize("slip", [-0.1, 1.0, 1.5, float("nan")])
def test_what_is_no_probability_below_one_is_refused(slip: float) -> None:
    with pytest.raises(InputError, match=r"slip must be in \[0, 1\)"):
        slipping_model(grid_combination(), slip)
