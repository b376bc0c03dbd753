"""A system under a policy as PRISM text, built by Storm, against the induced chain as arrays."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merap.checker.storm import build_text
from merap.concerns.combination import Combination
from merap.families.models import explored
from merap.mdp.chain import induced_chain
from merap.mdp.comparison import compare
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.model import Floats, TabularMDP
from merap.prism.policy_text import decimal_shares
from merap.prism.rendering import render_policy
from merap.program.names import KEYWORDS
from tests.support.hand_made import graph_combination, grid_combination, parsed, with_objective
from tests.support.random_combinations import random_combination

ONE_START = with_objective(graph_combination(), start=np.array([1.0, 0, 0, 0]))


def random_policy(model: TabularMDP, seed: int) -> Floats:
    """float64 [S, A]: some actions are hardly ever taken."""
    drawn = np.random.default_rng(seed).random(model.enabled.shape) ** 8 * model.enabled
    policy: Floats = drawn / np.maximum(drawn.sum(axis=1, keepdims=True), 1e-300)
    return policy


def chain_of(combination: Combination, seed: int = 0) -> TabularMDP:
    whole = explored(combination)
    return restrict_to_reachable(induced_chain(whole, random_policy(whole, seed)))


def require_agreement(combination: Combination, seed: int) -> None:
    """States, probabilities (1e-12), rewards (1e-9), labels and initial states of both routes."""
    chain = chain_of(combination, seed)
    built = build_text(render_policy(combination, chain, "a random policy"), "policy").mdp()
    starts = (chain.initial > 0).astype(np.float64)  # the language has them without weights
    named = replace(chain, initial=starts / starts.sum(), action_names=built.action_names)
    compare(built, named).require_same()
    assert set(chain.labels) <= set(built.labels)


@pytest.mark.parametrize("seed", range(12))
def test_storm_builds_the_chain_of_random_combinations(seed: int) -> None:
    require_agreement(random_combination(seed), seed)


@pytest.mark.parametrize(
    "combination", [grid_combination(), ONE_START, graph_combination()], ids=["grid", "graph", "two starts"]
)
def test_storm_builds_the_chain(combination: Combination) -> None:
    require_agreement(combination, 0)


def test_conditions_of_labels_are_decided_exactly() -> None:
    # light is 3 at S: 0.1 * 3 + 0.2 <= 0.5 holds, though it does not for doubles
    at_most = parsed("light * 0.1 + 0.2 <= 0.5 & light > 2")
    combination = with_objective(graph_combination(), unsafe=at_most)
    assert explored(combination).labels["unsafe"].any()
    require_agreement(combination, 0)


def test_rows_sum_to_one_as_they_are_written() -> None:
    """Exactly, by fractions: an engine that computes exactly accepts them too."""
    text = render_policy(ONE_START, chain_of(ONE_START), "a random policy")
    commands = re.findall(r"\[\] [^;]*-> ([^;]*);", text)
    sums = [sum(map(Fraction, re.findall(r"([\d.]+) :", command)), Fraction(0)) for command in commands]
    assert set(sums) == {Fraction(0), Fraction(1)}  # 0: a certain step, written without its probability
    assert sums.count(Fraction(1)) > 5


@given(st.lists(st.floats(1e-300, 1), min_size=1, max_size=6))
def test_shares_are_rounded_probabilities_that_sum_up(weights: list[float]) -> None:
    total = sum(weights)
    prob = np.array([weight / total for weight in weights])
    prob = prob[prob > 0]
    count = len(prob)
    shares = decimal_shares(star(prob))
    assert shares.sum() == 10**15 + count * 10**15  # the row, and those of its successors
    assert np.abs(shares[:count] - prob * 10**15).max() <= count
    assert shares.min() >= 0


def star(prob: Floats) -> TabularMDP:
    """State 0 leads to the others, which stay where they are."""
    count = len(prob)
    return TabularMDP(
        state_to_choice=np.arange(count + 2),
        choice_to_branch=np.append(0, np.arange(count, 2 * count + 1)),
        branch_target=np.tile(np.arange(1, count + 1), 2),
        branch_prob=np.append(prob, np.ones(count)),
        choice_action=np.zeros(count + 1, dtype=np.int64),
        choice_reward=np.zeros(count + 1),
        initial=np.append(1.0, np.zeros(count)),
        reachable=np.ones(count + 1, dtype=np.bool_),
        labels={},
        valuations=np.arange(count + 1)[:, np.newaxis],
        variable_names=("state",),
        action_names=("step",),
    )


def test_a_small_chain_reads_well() -> None:
    combination = grid_combination(size=2, goal=(0, 1))
    whole = explored(combination)
    policy = (whole.enabled * [1.0, 0, 0, 0, 3.0, 1.0])[:, : whole.num_actions]
    policy /= policy.sum(axis=1, keepdims=True)
    text = render_policy(combination, restrict_to_reachable(induced_chain(whole, policy)), "stop or right")
    assert (
        text
        == """// stop or right
// sources: 0000000000000000000000000000000000000000000000000000000000000000
dtmc

// the state of the system
formula pay_0 = row=0 & col=1 ? 17/8 : -1/2;

// each state with all that chance and the policy do there
module policy
  row : [0..1] init 0;
  col : [0..1] init 0;
  // 0 ready
  mode : [0..1] init 0;
  done : bool init false;

  [] row=0 & col=0 & mode=0 & !done -> 0.25 : true + 0.75 : (col'=1);
  [] row=0 & col=1 & mode=0 & !done -> (done'=true);
  [] done -> true;
endmodule

label "done" = done;
label "goal" = row=0 & col=1;

rewards "objective"
  mode=0 & !done : pay_0;
endrewards

// every step of every state plus a constant: PRISM-games takes no negative reward
const double shift = 1;
rewards "objective_shifted"
  mode=0 & !done : shift + pay_0;
  done : shift;
endrewards

rewards "steps"
  !done : 1;
endrewards
"""
    )


def test_the_shifted_rewards_are_the_others_plus_a_constant() -> None:
    """Over T steps: T * shift more, complete states included."""
    model = build_text(render_policy(ONE_START, chain_of(ONE_START), "a random policy"), "policy")
    plain, shifted = (
        model.check(f'R{{"{name}"}}=? [C<=12]').value for name in ("objective", "objective_shifted")
    )
    assert plain is not None
    assert shifted == pytest.approx(plain + 12 * 4, abs=1e-9)  # the least reward is -3


def test_several_starts_are_told_with_their_weights() -> None:
    text = render_policy(graph_combination(), chain_of(graph_combination()), "a random policy")
    assert "//   starts with probability 0.25 at loc=S\n//   starts with probability 0.75 at loc=A\n" in text
    assert "init 0" not in text
    assert re.search(r"^init\n  .*loc<=1 & mode=0 & !done\nendinit$", text, re.MULTILINE)


def test_no_name_of_a_chain_is_a_keyword() -> None:
    """Of Storm or of PRISM-games, beyond the words of the language that the text is made of."""
    text = render_policy(ONE_START, chain_of(ONE_START), "a random policy")
    plain = re.sub(r'//.*|"[^"]*"', "", text)
    language = {"dtmc", "formula", "module", "endmodule", "bool", "init", "true", "false", "label"}
    language |= {"rewards", "endrewards", "const", "double"}
    assert set(re.findall(r"[A-Za-z_]\w*", plain)) & KEYWORDS <= language
    assert {"policy", "pay_0", "complete", "shift", "loc", "mode", "done"} & KEYWORDS == set()
