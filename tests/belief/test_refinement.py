from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from merap.belief.model import DomainModel, mean_model, sampled_model, tabular
from merap.belief.planning import FinitePlan, plan, policy_values
from merap.belief.posterior import prior_belief
from merap.belief.refinement import Refinement, RefinementSettings, model_tasks
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.belief.strategy import BeliefStrategy
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.errors import MerapWarning
from merap.learning.config import TrainingConfig
from merap.learning.exact import expected_return
from merap.learning.meta import MetaPolicy
from merap.mdp.evaluation import expected_return as value_on
from merap.mdp.model import Floats
from merap.runs.checkpoint import read_policy
from merap.runs.train import tasks_of, train
from merap.strategies.evaluation import executed
from tests.support.belief_routes import STRIP
from tests.support.case_examples import GRAPH, write_case

HORIZON = 8


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path_factory.mktemp("strip"), STRIP))


@pytest.fixture(scope="module")
def meta(case: DeclaredCase, tmp_path_factory: pytest.TempPathFactory) -> MetaPolicy:
    with pytest.warns(MerapWarning, match=r"^not every task \(5 of 8\) can reach its goal within 8 steps"):
        run = train(case, tmp_path_factory.mktemp("runs") / "run", TrainingConfig(seed=0, updates=30))
    return read_policy(run, tasks_of(run))


def drawn(space: HypothesisSpace, count: int) -> list[DomainModel]:
    generator = np.random.default_rng(0)
    return [sampled_model(space, prior_belief(space), generator) for _ in range(count)]


def best_policy(best: FinitePlan) -> Floats:
    return np.eye(best.ranked.shape[2])[best.actions]


@pytest.mark.parametrize("text", [STRIP, GRAPH])
def test_values_of_a_policy_are_those_of_whole_models(tmp_path: Path, text: str) -> None:
    # Second route: the models on the canonical index, and their evaluation.
    space = hypothesis_space(load_declared_case(write_case(tmp_path, text)))
    models = [*drawn(space, 5), mean_model(space, prior_belief(space))]
    shape = (HORIZON, space.num_states, len(space.actions))
    policy = np.random.default_rng(1).dirichlet(np.ones(shape[2]), size=shape[:2])
    found = policy_values(models, policy, space.initial)
    with_end = np.concatenate([policy, np.full((HORIZON, 1, shape[2]), 1 / shape[2])], axis=1)
    for value, model in zip(found, models, strict=True):
        whole = tabular(space, model, space.initial)
        assert value == pytest.approx(value_on(whole, executed(whole, with_end), HORIZON), abs=1e-9)


def test_values_of_the_tasks_for_the_gradient_are_the_same(case: DeclaredCase) -> None:
    space = hypothesis_space(case)
    models = drawn(space, 5)
    tasks = model_tasks(models, space.initial, HORIZON)
    uniform = tasks.enabled / tasks.enabled.sum(dim=-1, keepdim=True).clamp_min(1)
    with torch.no_grad():
        found = expected_return(uniform.float(), tasks).numpy()
    everywhere = np.ones((HORIZON, space.num_states, len(space.actions)))
    np.testing.assert_allclose(found, policy_values(models, everywhere, space.initial), atol=1e-4)


def test_the_refined_meta_policy_is_taken_where_it_is_better(case: DeclaredCase, meta: MetaPolicy) -> None:
    # Before anything is seen the plan goes for one of two goals; a policy that hedges is worth more.
    space = hypothesis_space(case)
    belief = prior_belief(space)
    best = plan(mean_model(space, belief), HORIZON)
    refine = Refinement(meta, space, HORIZON, np.random.default_rng(0))
    found = refine(belief, best, best_policy(best), space.initial)
    assert found.policy is not None
    assert found.refined_value is not None
    assert found.refined_value > found.plan_value
    # Judged again on 400 models that neither has seen. No gain at all would pass with a chance of 2.3 %.
    many = drawn(space, 400)
    refined = policy_values(many, np.repeat(found.policy[np.newaxis], HORIZON, axis=0), space.initial)
    planned = policy_values(many, best_policy(best), space.initial)
    gain = refined - planned
    assert gain.mean() > 2 * gain.std() / np.sqrt(len(many))


def test_gradient_steps_raise_the_mean_return(case: DeclaredCase, meta: MetaPolicy) -> None:
    space = hypothesis_space(case)
    belief = prior_belief(space)
    best = plan(mean_model(space, belief), HORIZON)
    values = []
    for steps in (0, 1, 20):
        settings = RefinementSettings(models=64, steps=steps)
        refine = Refinement(meta, space, HORIZON, np.random.default_rng(3), settings)
        value = refine(belief, best, best_policy(best), space.initial).refined_value
        assert value is not None
        values.append(value)
    # The three are judged by the same models, since the same seed draws them first.
    assert values[2] > values[0] + 0.3
    assert values[1] > values[0]


def test_a_certain_belief_needs_no_refinement(case: DeclaredCase, meta: MetaPolicy) -> None:
    space = hypothesis_space(case)
    prior = np.full_like(space.prior, -np.inf)
    prior[0, 0, 0] = 0.0
    objective = np.full_like(space.objective_prior, -np.inf)
    objective[0] = 0.0
    space = replace(space, prior=prior, objective_prior=objective)
    belief = prior_belief(space)
    best = plan(mean_model(space, belief), HORIZON)
    refine = Refinement(meta, space, HORIZON, np.random.default_rng(0))
    found = refine(belief, best, best_policy(best), space.initial)
    assert found.policy is None
    assert found.refined_value is None
    assert found.plan_value == pytest.approx(best.values[0] @ space.initial, abs=1e-9)
    assert found.reason.endswith("the plan is kept")


def test_the_strategy_acts_on_it_and_says_so(case: DeclaredCase, meta: MetaPolicy) -> None:
    space = hypothesis_space(case)
    refine = Refinement(meta, space, HORIZON, np.random.default_rng(0))
    strategy = BeliefStrategy(space, HORIZON, np.random.default_rng(0), refine=refine)
    policy = strategy.policy()
    # The refined policy does not depend on time, and is stochastic; the plan is neither.
    np.testing.assert_array_equal(policy[0], policy[-1])
    assert policy[0, :-1].max(axis=1).min() < 0.999
    np.testing.assert_allclose(policy.sum(axis=-1), 1, atol=1e-6)
    assert strategy.explain()[-1].endswith("that is taken")
