from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from merap.belief.model import mean_model, sampled_model, tabular
from merap.belief.planning import information_price, objective_information, plan
from merap.belief.posterior import prior_belief
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.case_study import load_declared_case
from merap.families.models import built, explored
from merap.mdp.comparison import compare
from merap.mdp.planning import backward_induction
from tests.support.belief_routes import STRIP
from tests.support.case_examples import GRAPH, write_case
from tests.support.paths import MODELS
from tests.support.placed import as_believed


def certain(space: HypothesisSpace, environment: int, capability: int, objective: int) -> HypothesisSpace:
    """The same hypotheses with all of the prior on one of them."""
    prior = np.full_like(space.prior, -np.inf)
    prior[environment, capability, 0] = 0.0
    of_objective = np.full_like(space.objective_prior, -np.inf)
    of_objective[objective] = 0.0
    return replace(space, prior=prior, objective_prior=of_objective)


@pytest.mark.parametrize("index", range(8))
def test_a_belief_that_is_certain_has_the_model_that_storm_builds(tmp_path: Path, index: int) -> None:
    case = load_declared_case(write_case(tmp_path, GRAPH))
    e, c, o = np.unravel_index(index, case.shape)
    space = certain(hypothesis_space(case), int(e), int(c), int(o))
    belief = prior_belief(space)
    expected = as_believed(space, built(case.combination_at(index)))
    initial = expected.initial[:-1]
    for model in (mean_model(space, belief), sampled_model(space, belief, np.random.default_rng(0))):
        found = tabular(space, model, initial)
        same = compare(found, expected)
        assert same.same_states
        assert same.max_probability_difference < 1e-12
        assert same.max_reward_difference < 1e-9
        horizon = 12
        mine = plan(model, horizon)
        theirs = backward_induction(expected, horizon)
        assert mine.values[0] @ initial == pytest.approx(theirs.value, abs=1e-9)


def test_the_plan_is_that_of_the_tabular_mean() -> None:
    # Second route: `backward_induction` on the mean as a TabularMDP.
    case = load_declared_case(MODELS / "running-example")
    space = hypothesis_space(case)
    model = mean_model(space, prior_belief(space))
    theirs = backward_induction(tabular(space, model, space.initial), 40)
    assert plan(model, 40).values[0] @ space.initial == pytest.approx(theirs.value, abs=1e-9)


def test_the_mean_is_the_average_of_samples(tmp_path: Path) -> None:
    space = hypothesis_space(load_declared_case(write_case(tmp_path, STRIP)))
    belief = prior_belief(space)
    generator = np.random.default_rng(1)
    samples = np.array([sampled_model(space, belief, generator).prob for _ in range(600)])
    error = samples.std(axis=0) / np.sqrt(len(samples))
    # Four standard errors, and one sample's worth where none was seen.
    assert np.all(np.abs(samples.mean(axis=0) - mean_model(space, belief).prob) <= 4 * error + 1 / 600)


def test_information_is_the_entropy_of_what_a_step_shows(tmp_path: Path) -> None:
    space = hypothesis_space(load_declared_case(write_case(tmp_path, STRIP)))
    belief = prior_belief(space)
    told = objective_information(space, belief, mean_model(space, belief))
    # At a goal of the base, probability 0.475: any action ends the task there, and nowhere else.
    goal = int(space.space.location_index["r0c2"])
    expected = -(0.475 * np.log(0.475) + 0.525 * np.log(0.525))
    assert told[space.case.actions.index("stop"), goal] == pytest.approx(expected, abs=1e-9)


def test_knowing_the_objective_is_worth_nothing_if_it_is_known(tmp_path: Path) -> None:
    space = certain(hypothesis_space(load_declared_case(write_case(tmp_path, STRIP))), 0, 0, 0)
    belief = prior_belief(space)
    model = mean_model(space, belief)
    assert information_price(space, belief, model, plan(model, 8), space.initial) == 0
    assert not objective_information(space, belief, model).any()


def test_knowing_the_objective_is_worth_the_gap_to_the_informed(tmp_path: Path) -> None:
    # By hand, with everything open and sure but the goal, and 8 steps: r0c2 is 2 steps away, r1c2 is 3.
    case = load_declared_case(write_case(tmp_path, STRIP))
    space = hypothesis_space(case)
    prior = np.full_like(space.prior, -np.inf)
    prior[-1, 0, 0] = 0.0
    of_objective = np.full_like(space.objective_prior, -np.inf)
    of_objective[:2] = np.log(0.5)
    space = replace(space, prior=prior, objective_prior=of_objective, closed=1e-12)
    belief = prior_belief(space)
    model = mean_model(space, belief)
    best = plan(model, 8)
    informed = np.mean(
        [
            backward_induction(explored(task), 8).value
            for task in (
                replace(
                    case.combine(0, 0, goal),
                    environment=case.supports.environment.resolve("none", {"blocked": ()}),
                )
                for goal in (0, 1)
            )
        ]
    )
    gap = informed - best.values[0] @ space.initial
    price = information_price(space, belief, model, best, space.initial)
    assert price == pytest.approx(gap / np.log(2), rel=1e-6)
