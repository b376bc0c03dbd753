"""Rewards: the first rule that matches a step pays (rule 4 of the composition)."""

from __future__ import annotations

import numpy as np
import pytest

from merap.concerns.combination import Condition, RewardRule
from merap.families.models import explored
from merap.program.expressions import all_of
from tests.support.hand_made import at, graph_combination, number, parsed, with_objective
from tests.support.mdp_lookup import reward

IDLE, SCANNING, SCANNED = 0, 1, 2
S, A, B, G = 0, 1, 2, 3
NOT_AT_B = at(np.array([True, True, False, True]))


def test_the_first_rule_that_matches_pays() -> None:
    mdp = explored(graph_combination())
    assert reward(mdp, (G, SCANNED, 0), "stop") == 20
    # a step to G where it is lighter: light / 4 of the source (0 at B), else the rule for the dark idle B: -3
    assert reward(mdp, (B, IDLE, 0), "go") == pytest.approx(0.6 * 0 + 0.4 * -3)
    assert reward(mdp, (B, SCANNED, 0), "go") == pytest.approx(0.6 * 0 + 0.4 * -1)
    # into scanned 0.3, else -1
    assert reward(mdp, (S, SCANNING, 0), "measure") == pytest.approx(0.9 * 0.3 + 0.1 * -1)
    assert reward(mdp, (S, IDLE, 0), "stop") == -1


def test_no_rule_earns_nothing() -> None:
    mdp = explored(with_objective(graph_combination(), rules=()))
    assert not mdp.choice_reward.any()
    assert mdp.branch_reward is not None
    assert not mdp.branch_reward.any()


def test_a_rule_that_names_what_the_capability_lacks_never_matches() -> None:
    rules = (
        RewardRule(Condition(actions=frozenset({"fly"})), number(100)),
        RewardRule(Condition(), number(1)),
    )
    mdp = explored(with_objective(graph_combination(), rules=rules))
    assert set(mdp.choice_reward.tolist()) == {0.0, 1.0}


def test_a_value_is_computed_only_where_its_rule_matches() -> None:
    # light is 0 at B
    rules = (
        RewardRule(Condition(where=parsed("light > 0")), parsed("1 / light")),
        RewardRule(Condition(where=all_of([NOT_AT_B, parsed("1 / light > 1")])), number(9)),
    )
    mdp = explored(with_objective(graph_combination(), rules=rules))
    assert reward(mdp, (S, IDLE, 0), "stop") == pytest.approx(1 / 3)
    assert reward(mdp, (B, IDLE, 0), "stop") == 0


def test_a_condition_need_not_be_defined_where_the_rest_does_not_hold() -> None:
    # light is 0 at B alone
    rule = RewardRule(Condition(where=all_of([NOT_AT_B, parsed("1 / light > 0.4")])), parsed("2 / light"))
    mdp = explored(with_objective(graph_combination(), rules=(rule,)))
    assert reward(mdp, (A, IDLE, 0), "stop") == 1
    assert reward(mdp, (S, IDLE, 0), "stop") == reward(mdp, (B, IDLE, 0), "stop") == 0
