"""What can be learned on the systems of shipped cases: the best policies of other members lose there."""

from __future__ import annotations

import numpy as np
import pytest

import merap
from merap.families.index import index_kinds
from merap.families.models import explored
from merap.mdp.evaluation import expected_return
from merap.mdp.index import new_index
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import backward_induction, optimum
from tests.support.paths import MODELS

CASES = (
    "hospital",
    "web-service",
    "drone",
    "families/radio.yaml",
    "families/pump.yaml",
)
LEAST_LOSS = 0.1
# Best return over the horizon, undiscounted and discounted. Hospital: a plain enumeration outside of the
# project; web service: PRISM text written by hand, on which Storm and PRISM-games agree; radio: hops, and
# 4 / 0.95 packets; pump: in the highest safe gear, after the steps to get there.
VALUES = [
    ("hospital", "quiet.new_cells.to_a", 26.898566, 26.011089),
    ("hospital", "quiet.new_cells.to_b", 25.172027, 23.854336),
    ("hospital", "windy.old_cells.to_a", 26.525910, 25.541681),
    ("hospital", "windy.old_cells.to_b", 24.211769, 22.656303),
    ("hospital", "night.old_cells.to_b", 23.740048, 22.075168),
    ("hospital", "met", 22.073898, 20.052119),
    ("web-service", "rush.fast.quality", -114.531431, -85.756299),
    ("web-service", "calm.slow.thrift", -34.425167, -26.038373),
    ("families/radio.yaml", "clear_4.bad_antenna.default", -2 - 4 / 0.95, None),
    ("families/radio.yaml", "clear_1.good_antenna.default", -1 - 4 / 0.95, None),
    ("families/pump.yaml", "weak.old_seal.default", -20, None),
    ("families/pump.yaml", "fair.old_seal.default", -1 - 10, None),
    ("families/pump.yaml", "strong.new_seal.default", -3 - 5, None),
]


def enabled(model: TabularMDP) -> Floats:
    """float64 [S, A], 1 where an action can be taken."""
    mask = np.zeros((model.num_states, model.num_actions))
    mask[model.choice_state, model.choice_action] = 1
    return mask


def uniform_policy(model: TabularMDP) -> Floats:
    """float64 [S, A], every action that can be taken equally often."""
    mask = enabled(model)
    policy: Floats = mask / np.maximum(mask.sum(axis=1, keepdims=True), 1)
    return policy


def best_policy(member: TabularMDP, system: TabularMDP, horizon: int) -> Floats:
    """float64 [T, S, A], what is best for a member; uniform where the system can't do it."""
    actions = backward_induction(member, horizon).actions  # [T, S]
    chosen = (actions[:, :, None] == np.arange(system.num_actions)) * enabled(system)
    followed = chosen.sum(axis=2, keepdims=True) > 0
    return np.where(followed, chosen, uniform_policy(system))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_best_policies_of_other_members_lose(name: str) -> None:
    case = merap.load_case(MODELS / name)
    members, systems = list(case.combinations()), list(case.systems.values())
    names = tuple(kind.name for kind in index_kinds(one.program for one in (*members, *systems)))
    wholes = [explored(one) for one in (*members, *systems)]
    index = new_index(names, case.actions).extended(*wholes)
    models = [index.place(whole) for whole in wholes]
    assert set(case.systems) == {"covered", "met"}
    for system, model in zip(systems, models[len(members) :], strict=True):
        horizon = system.objective.horizon
        best = optimum(model, horizon)
        losses = [
            best - expected_return(model, best_policy(other, model, horizon), horizon)
            for member, other in zip(members, models, strict=False)
            if any(
                getattr(member, concern).parameters != getattr(system, concern).parameters
                for concern in ("environment", "capability", "objective")
            )
        ]
        assert len(losses) == len(members) - (system.name == "covered")
        scale = best - expected_return(model, uniform_policy(model), horizon)
        assert np.mean(losses) >= LEAST_LOSS * scale > 0, system.name


@pytest.mark.parametrize(("name", "combination", "best", "discounted"), VALUES)
def test_best_returns(name: str, combination: str, best: float, discounted: float | None) -> None:
    case = merap.load_case(MODELS / name)
    one = case.systems[combination] if combination in case.systems else case.combination(combination)
    model, horizon = explored(one), one.objective.horizon
    assert optimum(model, horizon) == pytest.approx(best, abs=1e-6)
    expected = best if discounted is None else discounted
    assert optimum(model, horizon, case.discount) == pytest.approx(expected, abs=1e-6)
