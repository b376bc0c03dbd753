"""Families of PRISM text: Storm's build of our text and our own exploration agree, values are known ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.combination_model import export_combination
from merap.families.loading import load_case
from merap.families.models import built, explored
from merap.families.prism_family import WrittenCase
from merap.mdp.comparison import compare
from merap.mdp.planning import optimum
from merap.mdp.umb import read_umb
from tests.support.prism_families import LAMPS, LAMPS_CASE, WALK, WALK_CASE, write_case, written_case


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> WrittenCase:
    return written_case(tmp_path_factory.mktemp("walk"), WALK_CASE, walk=WALK)


@pytest.fixture(scope="module")
def lamps(tmp_path_factory: pytest.TempPathFactory) -> WrittenCase:
    return written_case(tmp_path_factory.mktemp("lamps"), LAMPS_CASE, lamps=LAMPS)


# two steps to the lamp, then 1 / (1 - stick) attempts in the mean, cut off after 30 steps
@pytest.mark.parametrize(("name", "expected"), [("smooth", -3.1111), ("sticky", -4.0)])
def test_lamps_have_the_values_that_both_checkers_give(
    lamps: WrittenCase, name: str, expected: float
) -> None:
    combination = lamps.combination(f"prize_2.{name}.default")
    value = optimum(built(combination), combination.objective.horizon, combination.discount)
    assert value == pytest.approx(expected, abs=5e-5)


def test_a_family_has_one_program_for_all_its_members(lamps: WrittenCase) -> None:
    assert (lamps.shape, lamps.actions) == ((4, 2, 1), ("left", "right", "switch"))
    assert (lamps.discount, lamps.warnings) == (1.0, ())
    met = lamps.systems["met"]
    assert (met.environment.name, met.environment.parameters) == ("prize_2", {"prize": 2})
    assert (met.capability.name, met.capability.parameters) == ("met", {"stick": 0.3})
    assert not lamps.covered(met)


def test_every_member_is_the_same_by_both_routes(walk: WrittenCase) -> None:
    for combination in (*walk.combinations(), walk.systems["met"]):
        compare(built(combination), explored(combination)).require_same()


def test_actions_have_the_names_of_their_commands_in_the_whole_family(walk: WrittenCase) -> None:
    assert walk.actions == ("go#1.1", "go#2.1", "walker#1", "end_", "stay", "timer#1")
    # lazy members never have two commands of go at once; its name is that of the family
    lazy = built(walk.combination("near.lazy_true.long"))
    assert {lazy.action_names[action] for action in lazy.choice_action} == {
        "go#1.1",
        "stay",
        "timer#1",
        "end",
    }


def test_names_of_the_text_give_way_where_they_mean_something_else(walk: WrittenCase) -> None:
    changed = [warning.partition(": ")[2] for warning in walk.warnings]
    assert changed == [
        "end is called end_ here, as merap gives end another meaning",
        "done is called done_ here, as merap gives done another meaning",
    ]
    program = walk.systems["met"].program
    assert set(program.labels) == {"done", "done_", "goal", "unsafe"}
    assert set(program.rewards) == {"objective", "cost", "steps"}


def test_nothing_happens_in_complete_states(walk: WrittenCase) -> None:
    for combination in walk.combinations():
        model = explored(combination)
        complete = model.labels["done"][model.choice_state]
        ends = np.array(model.action_names)[model.choice_action] == "end"
        assert np.array_equal(complete, ends)
        assert not model.choice_reward[ends].any()
        inside = np.isin(model.branch_choice, np.flatnonzero(ends))
        source = model.choice_state[model.branch_choice]
        assert np.array_equal(source[inside], model.branch_target[inside])


def test_rewards_of_a_structure_are_costs_with_a_sign(walk: WrittenCase) -> None:
    model = explored(walk.combination("far.lazy_true.short"))
    rewards = {
        (*model.valuations[state].tolist(), model.action_names[action]): reward
        for state, action, reward in zip(
            model.choice_state, model.choice_action, model.choice_reward, strict=True
        )
    }
    # x > 0 costs 0.5 a step, go costs 2, a command without an action costs 1 where it is late
    assert rewards[1, 0, "go#1.1"] == -2.5
    assert rewards[1, 1, "timer#1"] == -1.5
    assert rewards[1, 0, "stay"] == -0.5


def test_a_horizon_may_be_a_parameter(walk: WrittenCase) -> None:
    horizons = {one.name.rpartition(".")[2]: one.objective.horizon for one in walk.combinations()}
    assert horizons == {"short": 4, "long": 9}
    assert walk.systems["met"].objective.horizon == 7


def test_one_file_holds_all_and_notices_changes(walk: WrittenCase, tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_bytes(walk.standalone)
    again = load_case(tmp_path)
    assert again.standalone == walk.standalone
    for one, other in zip(walk.combinations(), again.combinations(), strict=True):
        compare(explored(one), explored(other)).require_same()
    changed = written_case(tmp_path, WALK_CASE, walk=WALK.replace("0.5 : true", "0.5 :  true"))
    assert changed.digest != walk.digest


RULES = """\
objective:
  horizon: 5
  ends_in: late & x = N
  rewards:
    - {action: go, where: "x' > x", value: 4}
    - {action: go#2.1, value: "-x"}
    - {where: "home'", value: 1}
    - {value: "slip * 10"}
"""


def test_rules_may_read_constants_formulas_and_the_successor(tmp_path: Path) -> None:
    head, _, _ = WALK_CASE.partition("objective:")
    case = written_case(tmp_path, head + RULES.replace("home'", "x' = 0"), walk=WALK)
    combination = case.combination("near.lazy_false.default")
    compare(built(combination), explored(combination)).require_same()
    model = explored(combination)
    rewards = {
        (*model.valuations[state].tolist(), model.action_names[action]): reward
        for state, action, reward in zip(
            model.choice_state, model.choice_action, model.choice_reward, strict=True
        )
    }
    assert rewards[1, 0, "go#1.1"] == pytest.approx(0.75 * 4 + 0.25 * 2.5)
    assert rewards[2, 0, "go#2.1"] == pytest.approx(-2)
    assert rewards[0, 0, "stay"] == pytest.approx(1)
    assert rewards[2, 0, "stay"] == pytest.approx(2.5)


SEVERAL = """\
mdp
module m
  x : [0..5];
  [up] x<5 -> (x'=x+1);
endmodule
init x < 3 & x != 1 endinit
"""
SEVERAL_CASE = """\
case: several
program: {file: several.prism}
objective: {horizon: 5, goal: x = 5, ends_in: '"deadlock"', reward: "", sign: -1}
"""


def test_several_initial_states_are_equally_likely_and_a_deadlock_may_end_the_task(tmp_path: Path) -> None:
    text = f"{SEVERAL}rewards x>1 : 1; endrewards\n"
    case = written_case(tmp_path, SEVERAL_CASE, several=text)
    assert [one.partition(": ")[2] for one in case.warnings] == ["2 initial states, which are equally likely"]
    combination = case.combination_at(0)
    assert combination.name == "default.default.default"
    ours, theirs = explored(combination), built(combination)
    compare(theirs, ours).require_same()
    assert sorted(ours.initial[ours.initial > 0].tolist()) == [0.5, 0.5]
    # from 0 and from 2: three steps from states above 1 each
    assert optimum(ours, 5) == pytest.approx(-3)


def test_what_has_no_ends_has_no_complete_states(tmp_path: Path) -> None:
    path = write_case(tmp_path, WALK_CASE.replace("  ends_in", "  # ends_in"), walk=WALK)
    model = explored(load_case(path).combination_at(0))
    assert not model.labels["done"].any()


NAMES = """\
mdp
module player
  rate : [0..3] init 0;
  [label] rate<3 -> 0.5 : (rate'=rate+1) + 0.5 : true;
  [] true -> (rate'=0);
endmodule
"""
NAMES_CASE = """\
case: names
program: {file: names.prism}
objective:
  horizon: 5
  goal: rate = 3
  rewards: [{action: player#1, value: 2}]
"""


def test_exports_have_the_names_of_the_text(tmp_path: Path) -> None:
    case = written_case(tmp_path, NAMES_CASE, names=NAMES)
    (combination,) = case.combinations()
    compare(built(combination), explored(combination)).require_same()
    assert case.actions == ("label", "player#1")
    export_combination(combination, tmp_path / "names.umb")
    read = read_umb(tmp_path / "names.umb")
    compare(explored(combination), read).require_same()
    assert (read.variable_names, set(read.action_names)) == (("rate",), {"label", "player#1"})
