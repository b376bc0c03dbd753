"""Adaptation to systems that are met, against numbers made without the library's planner."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from merap.errors import InputError
from merap.families.models import explored
from merap.learning.config import TrainingConfig
from merap.mdp.evaluation import expected_return
from merap.mdp.index import index_of
from merap.mdp.model import Floats
from merap.runs.run_folder import RunFolder
from merap.runs.train import begin_run
from merap.strategies.adaptation import Adaptation, adapt, spread_of_pretrained
from merap.strategies.problem import Conditions, adaptation_problem
from merap.strategies.registry import BELIEF, GRADIENT
from tests.support.grid_tasks import END, HORIZON, grid_model, grid_task
from tests.support.trained_runs import ONE_OF_SIXTEEN, SMALL, grid_case, trained
from tests.support.whole_adaptations import moments, values

# What is met on RQ1-1: eight steps away, so the optimum is 10 - 0.5 * 8; at worst 18 steps for nothing.
MET = grid_model(grid_task((4, 4)))
OPTIMUM, WORST = 6.0, -9.0
TRAINING_SEEDS = (0, 1)


@pytest.fixture(scope="module")
def of_hasty(hasty: RunFolder) -> Adaptation:
    return adapt(
        hasty, hasty.case.system("met"), strategy="gradient", episodes_per_step=10, steps=3, seeds=(0, 1)
    )


@pytest.fixture(scope="module")
def of_belief(hasty: RunFolder) -> Adaptation:
    return adapt(hasty, hasty.case.system("met"), strategy=BELIEF, steps=6, seeds=(0, 1))


def meta_policy_of(run: RunFolder) -> Floats:
    """float64 [S, A + 1]: the stored network by numpy: softmax(W1' relu(W0[s] + b0) + b1)."""
    stored = {
        name: value.astype(np.float64) for name, value in load_file(run.path / "policy.safetensors").items()
    }
    hidden = np.maximum(stored["parameter.layer0.weight"] + stored["parameter.layer0.bias"], 0)
    logits = hidden @ stored["parameter.layer1.weight"] + stored["parameter.layer1.bias"]
    policy = np.exp(logits - logits.max(axis=1, keepdims=True))
    policy = np.column_stack([policy / policy.sum(axis=1, keepdims=True), np.zeros(len(policy))])
    policy[:2] = np.eye(END + 1)[END]  # completed at the goal and elsewhere
    return policy


def by_hand(policy: Floats) -> Floats:
    """The same policy for `MET`: its 81 cells and, last, its completed state."""
    assert policy.shape[-2] == 2 + 81, policy.shape
    return np.concatenate([policy[..., 2:, :], policy[..., :1, :]], axis=-2)


def test_row_0_is_before_any_episode(of_hasty: Adaptation) -> None:
    for run in of_hasty.runs:
        assert [(row.step, row.episodes) for row in run.curve] == [(0, 0), (1, 10), (2, 20), (3, 30)]
        assert run.curve[0].sampled_return is None
        assert all(row.sampled_return is not None for row in run.curve[1:])


def test_row_0_is_the_meta_policy_whatever_the_seed(hasty: RunFolder, of_hasty: Adaptation) -> None:
    mean, _ = moments(MET, by_hand(meta_policy_of(hasty)))
    assert values(of_hasty, 0)[0] == values(of_hasty, 1)[0] == pytest.approx(mean, abs=1e-5)  # float32


def test_the_range_is_that_of_the_paper(of_hasty: Adaptation) -> None:
    assert of_hasty.reachable.optimum == pytest.approx(OPTIMUM)
    assert of_hasty.reachable.worst == pytest.approx(WORST)


def test_expected_returns_are_those_of_the_policies_on_the_true_model(of_hasty: Adaptation) -> None:
    for policy, value in ((of_hasty.before, values(of_hasty)[0]), (of_hasty.after, values(of_hasty)[-1])):
        assert value == pytest.approx(moments(MET, by_hand(policy))[0], abs=1e-6)
        assert value == pytest.approx(expected_return(MET, by_hand(policy), HORIZON), abs=1e-9)


def test_belief_is_scored_on_the_true_model_too(of_belief: Adaptation) -> None:
    for policy, value in ((of_belief.before, values(of_belief)[0]), (of_belief.after, values(of_belief)[-1])):
        assert value == pytest.approx(moments(MET, by_hand(policy))[0], abs=1e-9)


def test_the_true_model_is_the_system_that_is_met(hasty: RunFolder, of_hasty: Adaptation) -> None:
    """What adaptation plays on, what is explored and what was made by hand are worth the same."""
    met = hasty.case.system("met")
    defined = index_of(of_hasty.model).place(explored(met))
    policy = meta_policy_of(hasty)
    mean, _ = moments(MET, by_hand(policy))
    for model in (of_hasty.model, defined):
        assert expected_return(model, policy, HORIZON) == pytest.approx(mean, abs=1e-9)


def test_sampled_returns_are_those_of_the_policy_that_acted(hasty: RunFolder) -> None:
    """Without exploration the episodes of step 1 are the meta policy's: within 4 standard errors."""
    episodes = 800
    found = adapt(
        hasty,
        hasty.case.system("met"),
        strategy="gradient",
        episodes_per_step=episodes,
        steps=1,
        seeds=(0, 1, 2),
    )
    mean, variance = moments(MET, by_hand(meta_policy_of(hasty)))
    assert variance > 0.01
    for run in found.runs:
        sampled = run.curve[1].sampled_return
        assert sampled is not None
        assert abs(sampled - mean) <= 4 * math.sqrt(variance / episodes)


def test_exploration_shows_in_what_is_sampled_and_not_in_what_is_expected(tmp_path: Path) -> None:
    """All but everything uniform: the sampled mean is that of the uniform policy."""
    run = trained(tmp_path / "run", SMALL.model_copy(update={"exploration": 0.999}), ONE_OF_SIXTEEN)
    episodes = 1500
    found = adapt(run, run.case.system("met"), strategy="gradient", episodes_per_step=episodes, steps=1)
    meta = meta_policy_of(run)
    uniform = np.where(np.arange(END + 1) < END, 0.2, 0.0) * np.ones((len(meta), 1))
    uniform[:2] = meta[:2]
    mean, variance = moments(MET, by_hand(0.999 * uniform + 0.001 * meta))
    sampled = found.runs[0].curve[1].sampled_return
    assert sampled is not None
    assert abs(sampled - mean) <= 4 * math.sqrt(variance / episodes)
    assert values(found)[0] == pytest.approx(moments(MET, by_hand(meta))[0], abs=1e-5)


@pytest.mark.parametrize("strategy", [GRADIENT, BELIEF])
def test_a_seed_gives_the_same_whatever_the_others(
    hasty: RunFolder, of_hasty: Adaptation, of_belief: Adaptation, strategy: str
) -> None:
    before, steps = (of_hasty, 3) if strategy == GRADIENT else (of_belief, 6)
    met = hasty.case.system("met")
    alone = adapt(hasty, met, strategy=strategy, episodes_per_step=10, steps=steps, seeds=(1,))
    assert alone.runs == before.runs[1:]
    shorter = adapt(hasty, met, strategy=strategy, episodes_per_step=10, steps=1, seeds=(1,))
    assert shorter.runs[0].curve == before.runs[1].curve[:2]


def test_seeds_differ(of_hasty: Adaptation) -> None:
    assert of_hasty.runs[0].curve[1] != of_hasty.runs[1].curve[1]


def test_belief_updates_after_every_episode(of_belief: Adaptation) -> None:
    for run in of_belief.runs:
        assert [(row.step, row.episodes) for row in run.curve] == [(step, step) for step in range(7)]
        # an episode's return is a multiple of 0.5 between the worst and the best
        assert all(
            row.sampled_return is not None
            and WORST <= row.sampled_return <= OPTIMUM
            and row.sampled_return % 0.5 == 0
            for row in run.curve[1:]
        )


def test_every_decision_of_every_run_is_explained(of_belief: Adaptation) -> None:
    assert [len(of_run) for of_run in of_belief.reasons] == [len(run.curve) for run in of_belief.runs]
    left, outside, *_ = of_belief.reasons[0][-1]
    # Which hypotheses are left, with what weight.
    assert "objective " in left
    assert " left)" in left
    assert outside.startswith("outside the base: environment ")
    assert of_belief.as_dict()["reasons"][1][-1] == list(of_belief.reasons[1][-1])


def test_belief_finds_a_covered_goal(of_belief: Adaptation) -> None:
    # The paper's README: 2 to 10 real episodes; here six.
    assert [values(of_belief, run)[-1] for run in (0, 1)] == pytest.approx([OPTIMUM, OPTIMUM])


def test_after_each_step_and_only_then_the_caller_is_told(hasty: RunFolder) -> None:
    told: list[int] = []
    adapt(
        hasty,
        hasty.case.system("met"),
        episodes_per_step=2,
        steps=3,
        seeds=(0, 1),
        on_step=lambda: told.append(1),
    )
    assert len(told) == 2 * 3


def test_what_it_is_as_data(of_hasty: Adaptation) -> None:
    found = of_hasty.as_dict()
    assert list(found) == [
        *("system", "reward_noise", "slip", "reset"),
        *("strategy", "optimum", "worst", "safe_optimum", "safely_completed"),
        *("runs", "reasons", "summary", "safety"),
    ]
    assert (found["reward_noise"], found["slip"], found["reset"]) == (0, 0, "episodes")
    assert (found["system"], found["strategy"]) == ("met", GRADIENT)
    assert [run["seed"] for run in found["runs"]] == [0, 1]


def test_a_combination_may_be_met(hasty: RunFolder) -> None:
    name = hasty.names[0]
    found = adapt(hasty, hasty.case.system(name), strategy="gradient", episodes_per_step=2, steps=1)
    assert found.system == name
    # its goal is the first of rows and columns 3 to 6: six steps
    assert found.reachable.optimum == pytest.approx(10 - 0.5 * 6)


def test_real_episodes_can_be_limited_instead_of_steps(hasty: RunFolder) -> None:
    found = adapt(hasty, hasty.case.system("met"), strategy="gradient", episodes_per_step=3, max_episodes=10)
    assert [row.episodes for row in found.runs[0].curve] == [0, 3, 6, 9]
    with pytest.raises(InputError, match="gradient takes 3 real episodes for a policy update; 2 are too few"):
        adapt(hasty, hasty.case.system("met"), strategy="gradient", episodes_per_step=3, max_episodes=2)


@pytest.fixture(scope="module")
def on_three(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "three", SMALL)


def test_pretrained_policies_show_their_best_median_and_worst(on_three: RunFolder) -> None:
    """RQ1-3 meets a cell that can't be entered, (3, 4); its three combinations are one such cell each."""
    problem = adaptation_problem(on_three, on_three.case.system("met"))
    found = spread_of_pretrained(problem, steps=3, seeds=(0, 1))
    assert len(found.values) == 3
    ranked = list(found.values.values())
    assert ranked == sorted(ranked, reverse=True)
    own = problem.truth.system.capability.name
    by_name = {name.split(".")[1]: value for name, value in found.values.items()}
    # 10 - 0.5 * 8, by a network of four units
    assert by_name[own] == pytest.approx(OPTIMUM, abs=0.1)
    names = list(found.values)
    for place, one in zip((0, 1, 2), found.shown, strict=True):
        assert one.strategy == f"pretrained:{names[place]}"
        # not adapted
        assert {row.expected_return for run in one.runs for row in run.curve} == {ranked[place]}
    assert list(found.as_dict()["values"]) == names


def test_the_oracle_has_no_regret(hasty: RunFolder) -> None:
    found = adapt(hasty, hasty.case.system("met"), strategy="oracle", steps=3, seeds=(0, 1))
    for run in found.runs:
        assert run.episodes_to_within_5_percent == 0
        assert run.cumulative_regret == pytest.approx(0, abs=1e-9)
        assert run.sampled_regret == pytest.approx(0, abs=1e-9)  # nothing is random


def test_what_cannot_be_met_is_refused(hasty: RunFolder) -> None:
    met = hasty.case.system("met")
    with pytest.raises(InputError, match=r"the probability to slip must be in \[0, 1\), it is 1"):
        adapt(hasty, met, conditions=Conditions(slip=1.0))
    with pytest.raises(InputError, match="the noise on rewards must be 0 or more, it is nan"):
        adapt(hasty, met, conditions=Conditions(reward_noise=math.nan))


def test_what_cannot_be_adapted_is_refused(hasty: RunFolder, tmp_path: Path) -> None:
    met = hasty.case.system("met")
    with pytest.raises(InputError, match="no seed"):
        adapt(hasty, met, seeds=())
    with pytest.raises(InputError, match="no strategy 'magic'; known: gradient, belief"):
        adapt(hasty, met, strategy="magic")
    with pytest.raises(InputError, match="'pretrained:all' is one policy for each task"):
        adapt(hasty, met, strategy="pretrained:all")
    unfinished = begin_run(tmp_path / "run", grid_case(), SMALL)
    with pytest.raises(InputError, match="training has not ended"):
        adapt(unfinished, unfinished.case.system("met"))


@pytest.mark.slow
def test_learning_is_good(tmp_path: Path) -> None:
    """Adaptation on RQ1-1 is soon within 5 percent and never stuck (here: in 8 steps; 30 would do).

    The bounds are far away: means of 1.1 to 1.5 steps and 0 of 300 runs stuck were measured, so by
    the rule of three under 1 percent are stuck at 95 percent confidence, and a mean of 3.5 over 20
    would take every run at more than twice what was seen. And there is no luck on one machine: seeds
    fix every bit. It could fail only where other arithmetic gives other training runs, as
    improbably as above.
    """
    steps: list[int | None] = []
    for seed in TRAINING_SEEDS:
        run = trained(tmp_path / str(seed), TrainingConfig(seed=seed), ONE_OF_SIXTEEN)
        found = adapt(
            run, run.case.system("met"), strategy="gradient", episodes_per_step=35, steps=8, seeds=range(10)
        )
        steps += [one.steps_to_within_5_percent for one in found.runs]
    reached = [step for step in steps if step is not None]
    assert len(reached) == len(steps) == 20
    assert np.mean(reached) <= 3.5
