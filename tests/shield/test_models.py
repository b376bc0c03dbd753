"""Outcome sets of explicit models: subsets, what is sure, what is refused."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from merap.errors import InputError, ModelError
from merap.mdp.model import Ints, TabularMDP
from merap.shield import outcomes
from merap.shield.fixpoint import robust_risk
from merap.shield.models import credible_models, model_sets
from tests.support.mdp_examples import State, make_mdp, random_mdp


def slippery(slip: float, *, detour: bool) -> TabularMDP:
    """From 0 across to 1 beside the hole 2, or around; the task ends in 3."""
    actions: dict[str, tuple[float, Mapping[State, float]]] = {
        "across": (0.0, {(1,): 1 - slip, (2,): slip} if slip else {(1,): 1.0})
    }
    if detour:
        actions["around"] = (0.0, {(1,): 1.0})
    return make_mdp(
        {
            (0,): actions,
            (1,): {"across": (0.0, {(3,): 1.0})},
            (2,): {"across": (0.0, {(2,): 1.0})},
            (3,): {"end": (0.0, {(3,): 1.0})},
        },
        actions=("across", "around", "end"),
        labels={"unsafe": {(2,)}, "done": {(3,)}},
    )


def test_only_credible_models_count() -> None:
    sets = model_sets([slippery(0.0, detour=True), slippery(0.2, detour=True), slippery(0.4, detour=False)])
    risks = {
        kept: robust_risk(sets.outcomes(np.array(kept)))
        for kept in ((True, False, False), (True, True, False), (True, True, True))
    }
    across = [float(risk.of_actions[0, 0]) for risk in risks.values()]
    assert across == [0.0, pytest.approx(0.2), pytest.approx(0.4)]
    # The way around is not sure in the third model, so that state 0 can't rely on it.
    assert [float(risk.of_states[0]) for risk in risks.values()] == [0.0, 0.0, pytest.approx(0.4)]


def test_equal_distributions_are_kept_once() -> None:
    sets = model_sets([slippery(0.2, detour=True)] * 5 + [slippery(0.1, detour=True)])
    # Across with two slips, around, and on: the completed state has none.
    assert len(sets.rows.choice) == 5
    assert len(sets.kind) == 6 * 4
    every = sets.outcomes(np.ones(6, dtype=np.bool_))
    assert every.sure.all()
    assert np.diff(np.append(every.first, len(every.rows.choice))).tolist() == [2, 1, 1, 1]


@pytest.mark.parametrize("seed", range(5))
def test_a_subset_is_as_if_it_were_all(seed: int) -> None:
    generator = np.random.default_rng(seed)
    models = [random_mdp(generator, num_states=10) for _ in range(5)]
    target = models[0].labels["target"]
    kept = np.array([True, False, True, False, True])
    part = robust_risk(model_sets(models, target).outcomes(kept))
    chosen = [model for model, keep in zip(models, kept, strict=True) if keep]
    alone = robust_risk(model_sets(chosen, target).outcomes(np.ones(3, dtype=np.bool_)))
    np.testing.assert_allclose(part.of_actions, alone.of_actions, atol=1e-9)
    assert np.array_equal(part.certain, alone.certain)


def test_many_models_with_many_states() -> None:
    # A ring of 1000 states with a hole, 100 slips: each choice keeps 100 distributions, and the worst
    # is the largest slip. From beside the hole it is safe to wait.
    size = 1000
    models = [_ring(size, 0.002 * (number + 1)) for number in range(100)]
    sets = model_sets(models)
    risk = robust_risk(sets.outcomes(np.ones(100, dtype=np.bool_)))
    assert risk.of_actions[1, 0] == pytest.approx(0.2)
    assert risk.of_states[1] == 0.0


def _ring(size: int, slip: float) -> TabularMDP:
    """State 0 is a hole; `on` moves forward and slips back, `wait` stays."""
    here = np.arange(size)
    target = np.stack([(here + 1) % size, (here - 1) % size, here], axis=1)
    return TabularMDP(
        state_to_choice=2 * np.arange(size + 1),
        choice_to_branch=np.concatenate([[0], np.cumsum(np.tile([2, 1], size))]),
        branch_target=target.ravel(),
        branch_prob=np.tile([1 - slip, slip, 1.0], size),
        choice_action=np.tile([0, 1], size),
        choice_reward=np.zeros(2 * size),
        initial=(here == 2) * 1.0,
        reachable=np.ones(size, dtype=np.bool_),
        labels={"unsafe": here == 0},
        valuations=here[:, np.newaxis],
        variable_names=("place",),
        action_names=("on", "wait"),
    )


def test_models_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match="at least one model"):
        model_sets([])
    other = make_mdp({(0,): {"go": (0.0, {(0,): 1.0})}})
    with pytest.raises(InputError, match="model 0 has no label 'unsafe'"):
        model_sets([other])
    with pytest.raises(ModelError, match="model 1 has other states or actions"):
        model_sets([slippery(0.1, detour=True), other])
    with pytest.raises(InputError, match="credible"):
        model_sets([slippery(0.1, detour=True)]).outcomes(np.zeros(1, dtype=np.bool_))


def test_a_colliding_hash_does_not_merge_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def poor_at_first(block: Ints, salt: outcomes.Hashes) -> outcomes.Hashes:
        calls.append(salt)
        return np.zeros(len(block), dtype=np.uint64) if len(calls) == 1 else hashes(block, salt)

    hashes = outcomes._hashes
    monkeypatch.setattr(outcomes, "_hashes", poor_at_first)
    block = np.array([[1, 2], [1, 3], [1, 2]])
    representative, kind = outcomes.distinct(lambda: [block])
    assert len(calls) == 2
    assert sorted(representative.tolist()) == [0, 1]
    assert kind[0] == kind[2] != kind[1]


def test_the_true_model_is_dropped_no_more_often_than_declared() -> None:
    # A coin of 0.5 against one of 0.6, prior 0.02: in 2000 runs of 200 tosses a fair coin is ever
    # dropped in at most 5 % (Ville). Chance of failing by luck with a true rate of 5 %: the sample
    # exceeds 6.5 % with a probability below 0.002.
    tosses = np.random.default_rng(0).random((2000, 200)) < 0.5
    ratio = np.cumsum(np.where(tosses, np.log(0.6 / 0.5), np.log(0.4 / 0.5)), axis=1)
    fair = 0.02 / (0.02 + 0.98 * np.exp(ratio))
    posterior = np.stack([fair, 1 - fair], axis=-1)
    credible = credible_models(np.array([0.02, 0.98]), posterior, 0.05)
    dropped = ~credible[..., 0].all(axis=1)
    assert 0 < dropped.mean() < 0.065
    # What is dropped at a time holds at most 5 % of the posterior then.
    assert np.where(credible, 0.0, posterior).sum(axis=-1).max() <= 0.05
