from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from merap.checker.verdicts import Verdict, verify
from merap.concerns.combination import Condition, DeclaredCombination
from merap.errors import InputError
from merap.families.loading import load_case
from tests.support.hand_made import (
    at,
    cells,
    graph_combination,
    grid_combination,
    number,
    with_capability,
    with_objective,
)
from tests.support.slow_chain import slow_case


def verdicts(combination: DeclaredCombination) -> dict[str, Verdict]:
    return {verdict.name: verdict for verdict in verify([combination])}


def with_properties(combination: DeclaredCombination, **properties: str) -> DeclaredCombination:
    return with_objective(combination, properties=properties)


def test_every_combination_has_the_three_default_verdicts() -> None:
    found = verdicts(grid_combination())
    assert list(found) == ["reach", "reach_within_horizon", "reward"]
    assert {verdict.combination for verdict in found.values()} == {"e.c.o"}
    assert {verdict.engine for verdict in found.values()} == {"storm"}
    assert {verdict.status for verdict in found.values()} == {"ok"}
    reach, in_time, reward = found.values()
    assert (reach.value, reach.holds, reach.reason) == (1, True, None)
    assert (in_time.value, in_time.holds) == (1, None)
    # eight steps of -0.5 and then 10, discounted by 0.95: closed form
    expected = sum(-0.5 * 0.95**step for step in range(8)) + 10 * 0.95**8
    assert reward.value == pytest.approx(expected, abs=1e-9)
    assert reward.property == 'R{"objective"}max=? [C<=18discount=0.95]'
    assert reward.lower is not None
    assert reward.value is not None
    assert reward.upper is not None
    assert reward.lower <= reward.value <= reward.upper


def test_without_discount_the_reward_is_the_undiscounted_optimum() -> None:
    reward = verdicts(replace(grid_combination(), discount=1.0))["reward"]
    assert reward.value == 6  # 10 - 0.5 * 8
    assert reward.property == 'R{"objective"}max=? [C<=18]'


@pytest.mark.parametrize("discount", [1e-5, 0.1, 0.999999])
def test_any_discount_can_be_written(discount: float) -> None:
    reward = verdicts(replace(grid_combination(), discount=discount))["reward"]
    expected = sum(-0.5 * discount**step for step in range(8)) + 10 * discount**8
    # where the goal is worth less than the way costs, all steps cost 1/2
    wandering = sum(-0.5 * discount**step for step in range(18))
    assert reward.value == pytest.approx(max(expected, wandering), abs=1e-9)


def test_the_horizon_cuts_the_way_short() -> None:
    short = verdicts(with_objective(grid_combination(), horizon=7))
    assert short["reach"].value == 1
    assert short["reach_within_horizon"].value == 0


def test_an_unreachable_goal_is_a_false_verdict_that_says_why() -> None:
    wall = grid_combination(blocked=cells((3, 4), (5, 4), (4, 3)), no_entry=cells((4, 5)))
    found = verdicts(wall)
    assert (found["reach"].holds, found["reach"].value) == (False, 0)
    assert found["reach"].reason == (
        "cut off by blocked r3c4, r4c3, r5c4 (environment e); no entry to r4c5 (capability c)"
    )
    assert found["reward"].holds is None


def test_a_goal_that_modes_keep_out_of_reach_is_false_too() -> None:
    graph = graph_combination()
    assert graph.capability.innate is not None
    # external actions only in a mode that is never entered
    innate = replace(graph.capability.innate, terminal=frozenset({2}), restart=False)
    idle = replace(
        innate, actions=(replace(innate.actions[0], transitions={0: {0: number(1)}, 1: {2: number(1)}}),)
    )
    found = verdicts(with_objective(with_capability(graph, innate=idle), ends_in=None))
    assert found["reach"].holds is False
    assert found["reach"].reason == (
        "the goal can be reached in space; what actions require, the modes, or where the task ends prevent it"
    )


def test_a_task_that_ends_on_the_way_never_gets_there() -> None:
    found = verdicts(with_objective(grid_combination(), ends_after=Condition()))
    assert found["reach"].holds is False
    assert found["reach"].reason is not None
    assert "where the task ends" in found["reach"].reason


def test_a_property_with_a_bound_holds_or_says_what_is_missing() -> None:
    combination = with_properties(
        graph_combination(), soon='Pmax>=0.9 [F<=2 "goal"]', ever='Pmax>=0.9 [F "goal"]'
    )
    found = verdicts(combination)
    assert list(found) == ["reach", "reach_within_horizon", "reward", "soon", "ever"]
    assert (found["ever"].holds, found["ever"].reason) == (True, None)
    soon = found["soon"]
    assert soon.holds is False
    # from S (1/4): jump to B with 1/2, then 0.6; from A (3/4): 0.9 to B, then 0.6
    assert soon.value == pytest.approx(0.25 * 0.5 * 0.6 + 0.75 * 0.9 * 0.6)
    assert soon.reason == "the goal can be reached in space; the value is 0.48"


def test_an_own_property_replaces_a_default_of_its_name() -> None:
    found = verdicts(with_properties(grid_combination(), reach='Pmin>=0.5 [F "goal"]'))
    assert list(found) == ["reach", "reach_within_horizon", "reward"]
    assert found["reach"].property == 'Pmin>=0.5 [F "goal"]'
    assert found["reach"].holds is False
    assert found["reach"].value == 0


def test_what_storm_cannot_answer_is_unsupported_and_not_false() -> None:
    combination = with_properties(grid_combination(), cost='R{"objective"}min=? [F "goal"]')
    cost = verdicts(combination)["cost"]
    assert (cost.status, cost.holds, cost.value) == ("unsupported", None, None)
    assert cost.reason is not None
    assert "below 0" in cost.reason


def test_a_property_that_is_wrong_is_an_error() -> None:
    with pytest.raises(InputError, match=r"e.c.o: property .* unknown label 'gaol'; did you mean 'goal'\?"):
        verdicts(with_properties(grid_combination(), typo='Pmax=? [F "gaol"]'))


def test_one_property_alone() -> None:
    combinations = [grid_combination(), replace(grid_combination(goal=(0, 8)), name="e.c.p")]
    found = list(verify(combinations, only="reach_within_horizon"))
    assert [(verdict.combination, verdict.name) for verdict in found] == [
        ("e.c.o", "reach_within_horizon"),
        ("e.c.p", "reach_within_horizon"),
    ]
    with pytest.raises(
        InputError, match="no property is called 'win'; there are reach, reach_within_horizon"
    ):
        list(verify(combinations, only="win"))


def test_start_weights_count() -> None:
    # (0, 0) is eight steps from the goal (8, 0), (8, 4) is four
    start = np.zeros(81)
    start[[0, 8 * 9 + 4]] = 0.2, 0.8
    combination = with_objective(grid_combination(goal=(8, 0)), start=start)
    for horizon, value in ((3, 0), (4, 0.8), (7, 0.8), (8, 1)):
        found = verdicts(with_objective(combination, horizon=horizon))
        assert found["reach_within_horizon"].value == pytest.approx(value)


def test_a_verdict_is_json_even_if_it_is_infinite() -> None:
    combination = with_properties(grid_combination(), forever='R{"steps"}max=? [F "done"]')
    verdict = verdicts(combination)["forever"]
    assert verdict.value == np.inf
    assert json.loads(json.dumps(verdict.as_dict(), allow_nan=False)) == {
        "combination": "e.c.o",
        "name": "forever",
        "property": 'R{"steps"}max=? [F "done"]',
        "engine": "storm",
        "value": "inf",
        "lower": "inf",
        "upper": "inf",
        "holds": None,
        "status": "ok",
        "reason": None,
    }


def without_goal(combination: DeclaredCombination) -> DeclaredCombination:
    return with_objective(combination, goal=None)


def test_without_a_goal_the_defaults_are_about_the_end_of_the_task() -> None:
    graph = without_goal(graph_combination())
    ending = with_objective(
        graph, ends_in=None, ends_after=Condition(where=at(np.array([False, False, False, True])))
    )
    found = verdicts(ending)
    assert list(found) == ["complete", "complete_within_horizon", "reward"]
    assert found["complete"].property == 'Pmax=? [F "done"]'
    assert (found["complete"].holds, found["complete"].reason) == (True, None)
    assert {verdict.status for verdict in found.values()} == {"ok"}


def test_without_goal_and_end_the_default_is_the_reward() -> None:
    endless = with_objective(without_goal(graph_combination()), ends_in=None, ends_after=None)
    found = verdicts(endless)
    assert list(found) == ["reward"]
    assert found["reward"].holds is None
    # what an own property lacks is its value, as there is no goal to be cut off from
    missed = verdicts(with_properties(endless, rich='R{"objective"}max>=1000 [C<=2]'))["rich"]
    assert missed.holds is False
    assert missed.reason is not None
    assert missed.reason.startswith("the value is ")


def test_one_property_is_checked_where_there_is_one() -> None:
    combinations = [replace(without_goal(graph_combination()), name="e.c.n"), graph_combination()]
    assert [verdict.combination for verdict in verify(combinations, only="reach")] == ["e.c.o"]
    with pytest.raises(InputError, match="no property is called 'reach'; there are "):
        list(verify(combinations[:1], only="reach"))


@pytest.mark.slow
def test_a_property_over_its_time_has_no_answer_and_the_others_do() -> None:
    endless = 'Pmax=? [F<=2000000000 "goal"]'
    combination = with_properties(graph_combination(), endless=endless, ever='Pmax>=0.9 [F "goal"]')
    found = {verdict.name: verdict for verdict in verify([combination], timeout=4)}
    assert list(found) == ["reach", "reach_within_horizon", "reward", "endless", "ever"]
    assert {name for name, verdict in found.items() if verdict.status == "timeout"} == {"endless"}
    late = found["endless"]
    assert (late.value, late.lower, late.upper, late.holds) == (None, None, None, None)
    assert late.reason == f"e.c.o: property {endless!r}: not done within 4 s"
    assert found["ever"].holds is True


def test_a_model_that_is_not_built_in_time_has_no_answers() -> None:
    found = list(verify([grid_combination(), replace(grid_combination(), name="e.c.p")], timeout=1e-6))
    assert [(verdict.combination, verdict.status) for verdict in found] == [
        (name, "timeout") for name in ("e.c.o", "e.c.p") for _ in range(3)
    ]


def test_the_slowly_mixing_chain_is_verified(tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(slow_case(20, """    half: 'Pmax>=0.5 [F "goal"]'"""), encoding="utf-8")
    found = {verdict.name: verdict for verdict in verify(load_case(path).combinations())}
    assert found["reach"].value == pytest.approx(0.5, abs=1e-9)
    assert found["half"].holds is True
