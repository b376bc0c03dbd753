"""Programs as PRISM text that Storm builds, against their exploration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from merap.errors import InputError, ModelError
from merap.prism.program_text import render_program
from merap.program.arrays import tabular
from merap.program.exploration import explore
from merap.program.expressions import parse
from merap.program.form import InitialValues, Program, RewardItem, RewardStructure
from tests.support.explored import choices_of
from tests.support.programs import ONE_COIN, programs
from tests.support.storm_choices import build, choices_of_storm


def built(folder: Path, text: str) -> Any:
    path = folder / "model.prism"
    path.write_text(text, encoding="utf-8")
    return build(path, {})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("text")


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(program=programs())
def test_storm_builds_of_the_text_what_is_explored(program: Program, folder: Path) -> None:
    try:
        found = explore(program)
        text = render_program(program)
    except (InputError, ModelError):
        return  # a fault, which others test, or too many cases for a table
    assert choices_of_storm(program, built(folder, text)) == choices_of(program, found)


def test_a_decision_on_decimals_is_one_on_whole_numbers(folder: Path) -> None:
    text = render_program(ONE_COIN)
    assert 'label "goal" = x<=3 & x>2;' in text
    model = built(folder, text)
    assert len(list(model.labeling.get_states("goal"))) == 1


def test_a_condition_that_is_defined_nowhere_stays_a_condition(folder: Path) -> None:
    # the right side is undefined everywhere, and never looked at
    guarded = replace(ONE_COIN, labels={"goal": parse("x <= 3 | 1 / (x - x) > 1")})
    text = render_program(guarded)
    assert 'label "goal" = x<=3;' in text
    assert len(list(built(folder, text).labeling.get_states("goal"))) == 4


def test_the_arrays_have_names_labels_and_rewards() -> None:
    mdp = tabular(ONE_COIN, explore(ONE_COIN), reward="steps")
    assert mdp.action_names == ("toss", "rest")
    assert mdp.labels["goal"].tolist() == [False, False, False, True]
    assert mdp.choice_reward.tolist() == [1, 1, 1, 0]


def test_rewards_that_add_up_have_a_structure_without_losses() -> None:
    rules = (
        RewardItem(parse("-2 * x"), parse("x > 1")),
        RewardItem(parse("-1/2"), actions=frozenset({"toss"})),
        RewardItem(parse("3")),
    )
    losing = replace(ONE_COIN, rewards={"earned": RewardStructure(rules, shift="more")})
    text = render_program(losing)
    # no step loses more than 2 * 3 + 1/2
    assert "const double more = 7;" in text
    assert (
        """rewards "earned_shifted"
  x>1 : (-2) * x;
  [toss] true : -1/2;
  true : 3;
  true : more;
endrewards
"""
        in text
    )


def test_an_initial_value_of_probability_0_is_no_initial_state(folder: Path) -> None:
    starts = [("p", "1"), ("1 - p", "2"), ("0", "3")]
    for p, states, text in (("0", 1, "x : [0..3] init 2;"), ("0.5", 2, "x=1 | x=2")):
        process = replace(
            ONE_COIN.processes[0],
            initial=tuple(
                InitialValues(parse(probability.replace("p", p)), {"x": parse(x)})
                for probability, x in starts
            ),
        )
        program = Program("starts", (process,))
        written = render_program(program)
        assert text in written
        assert len(built(folder, written).initial_states) == states
