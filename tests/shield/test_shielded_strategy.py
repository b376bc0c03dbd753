"""Strategies behind a shield on the shipped cases; violations counted from outside."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.belief.strategy import BeliefStrategy
from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.mdp.model import Bools, Floats
from merap.shield.learning_shield import ShieldSettings
from merap.shield.models import model_sets
from merap.shield.policy import policy_risk
from merap.shield.shielded_strategy import ShieldedStrategy
from merap.shield.supervision import Safety, Supervised, total
from merap.strategies.protocol import episode
from merap.systems.interface import Observation
from merap.systems.simulated import SimulatedSystem
from merap.systems.slip import slipping_model
from merap.systems.strategy import Strategy
from tests.support.paths import MODELS
from tests.support.placed import as_believed


@cache
def shipped(name: str) -> tuple[DeclaredCase, HypothesisSpace]:
    case = load_declared_case(MODELS / name)
    return case, hypothesis_space(case)


class Reckless:
    """Drives at random and learns nothing."""

    episodes_per_update = 1

    def __init__(self, space: HypothesisSpace, generator: np.random.Generator) -> None:
        self._generator = generator
        self._shape = (space.num_states + 1, len(space.actions))

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        pass

    def act(self, allowed: Bools) -> int:
        return int(self._generator.choice(np.flatnonzero(allowed)))

    def observe(self, action: int, observation: Observation) -> None:
        pass

    def update(self) -> None:
        pass

    def policy(self) -> Floats:
        return np.full(self._shape, 1 / self._shape[1])

    def explain(self) -> tuple[str, ...]:
        return ("at random",)


def met(name: str, strategy: Strategy, episodes: int, seed: int, system: str = "met") -> Safety:
    combination = shipped(name)[0].system(system)
    simulated = SimulatedSystem(combination, combination.objective.horizon, np.random.default_rng(seed))
    supervised = Supervised(simulated)
    for _ in range(episodes):
        episode(supervised, strategy)
        strategy.update()
    return supervised.safety(strategy.report() if isinstance(strategy, ShieldedStrategy) else None)


def shielded(name: str, strategy: Strategy, threshold: float, system: str = "met") -> ShieldedStrategy:
    case, space = shipped(name)
    horizon = case.system(system).objective.horizon
    return ShieldedStrategy(strategy, space, horizon, ShieldSettings(threshold))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hazard-grid", "running-example"])
def test_driving_at_random_is_safe_behind_a_shield_and_not_without(name: str) -> None:
    _, space = shipped(name)
    alone = met(name, Reckless(space, np.random.default_rng(1)), 12, 0)
    kept = met(name, shielded(name, Reckless(space, np.random.default_rng(1)), 0.0), 4, 0)
    # At random an episode is violated with a probability of 0.845 on hazard-grid and 0.326 on the running
    # example (`policy_risk` of the even policy), so that 12 without any have one of 2e-10 and 0.009.
    assert alone.violations > 0
    assert kept.violations == 0
    assert kept.shield is not None
    assert kept.shield.fallbacks == 0
    assert kept.shield.withheld > 0
    assert kept.shield.worst_risk == 0


@pytest.mark.slow
def test_a_planner_gets_to_the_goal_behind_a_shield() -> None:
    _, space = shipped("hazard-grid")
    planner = BeliefStrategy(space, 40, np.random.default_rng(2))
    strategy = shielded("hazard-grid", planner, 0.0)
    found = met("hazard-grid", strategy, 3, 3)
    # By way of the upper rows the corner is at most 18 steps away; a robot that waits where its plan is
    # forbidden would never complete.
    assert (found.completed, found.violations) == (3, 0)
    *_, line = strategy.explain()
    assert line.startswith("shield at 0: ")


def test_a_planner_keeps_to_a_mask() -> None:
    _, space = shipped("hazard-grid")
    planner = BeliefStrategy(space, 10, np.random.default_rng(0))
    mask = np.ones((space.num_states + 1, len(space.actions)), dtype=np.bool_)
    right = space.case.actions.index("right")
    mask[:, right] = False
    mask[5] = False
    assert planner.policy()[:, :, right].any()
    planner.restrict(mask)
    policy = planner.policy()[:, :-1]
    # State 5 has nothing left in the mask and is not restricted; the completed state is nobody's.
    assert not np.delete(policy, 5, axis=1)[..., right].any()
    assert policy[:, 5, right].any()


def test_the_policy_is_within_the_mask_under_every_model_of_the_base() -> None:
    case, space = shipped("hazard-grid")
    strategy = shielded("hazard-grid", Reckless(space, np.random.default_rng(0)), 0.05)
    policy = strategy.policy()
    models = [as_believed(space, slipping_model(one, 0.0)) for one in case.combinations()]
    sets = model_sets(models).outcomes(np.ones(len(models), dtype=np.bool_))
    start = np.append(space.initial, 0.0)
    assert float(start @ policy_risk(sets, policy, 40)) <= 0.05
    # Unmasked it would reach a hole nearly always.
    even = np.full(policy.shape, 1 / policy.shape[-1])
    assert float(start @ policy_risk(sets, even, 40)) > 0.5
    np.testing.assert_allclose(policy.sum(axis=-1), 1, atol=1e-12)


@pytest.mark.slow
def test_an_island_is_reached_only_with_a_threshold() -> None:
    # Every way to the goal in the middle risks a slide to both sides. At 0 nobody gets there; with the
    # worst tyres of the base and what lies beyond it in mind 0.4 is enough, and the episodes that end in
    # a hole are few (true risk 0.1 each; of 5 episodes more than 3 have a chance of 5e-4).
    _, space = shipped("hazard-grid")
    never = shielded("hazard-grid", BeliefStrategy(space, 40, np.random.default_rng(2)), 0.0, "island")
    assert met("hazard-grid", never, 1, 3, "island").completed == 0
    some = shielded("hazard-grid", BeliefStrategy(space, 40, np.random.default_rng(2)), 0.4, "island")
    found = met("hazard-grid", some, 5, 3, "island")
    assert found.completed >= 2
    assert found.violations <= 3


@pytest.mark.slow
def test_sums_over_adaptations() -> None:
    _, space = shipped("hazard-grid")
    runs = [
        met("hazard-grid", shielded("hazard-grid", Reckless(space, np.random.default_rng(n)), 0.0), 1, n)
        for n in range(2)
    ]
    sums = total(runs)
    assert (sums["episodes"], sums["violations"]) == (2, 0)
    assert sums["shield"]["steps"] == sum(one.as_dict()["shield"]["steps"] for one in runs)
    assert total([replace(one, shield=None) for one in runs])["shield"] is None


def test_nothing_is_unsafe_where_the_objective_says_nothing() -> None:
    case, space = shipped("hazard-grid")
    system = case.system("met")
    harmless = replace(system, objective=replace(system.objective, unsafe=None))
    supervised = Supervised(SimulatedSystem(harmless, harmless.objective.horizon, np.random.default_rng(0)))
    reckless = Reckless(space, np.random.default_rng(1))
    for _ in range(12):
        episode(supervised, reckless)
    assert supervised.safety(None).violations == 0


def test_a_task_that_ends_in_an_unsafe_state_is_a_violation() -> None:
    """Every hole ends the task: at random it is met with, as above; the last observation doesn't tell."""
    case, space = shipped("hazard-grid")
    system = case.system("met")
    ending = replace(system, objective=replace(system.objective, ends_in=system.objective.unsafe))
    simulated = SimulatedSystem(ending, ending.objective.horizon, np.random.default_rng(0))
    supervised = Supervised(simulated)
    reckless = Reckless(space, np.random.default_rng(1))
    for _ in range(12):
        episode(supervised, reckless)
    found = supervised.safety(None)
    assert 0 < found.violations <= found.completed
