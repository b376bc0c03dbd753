"""Expressions read parameters and variables of every concern, by the names that they have there."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from merap.concerns.case_study import DeclaredCase, load_declared_case
from merap.errors import InputError, ModelError
from merap.mdp.model import TabularMDP
from merap.program.arrays import tabular
from merap.program.exploration import explore
from tests.support.case_examples import replaced, write_case
from tests.support.objective_cases import PUMP


@pytest.fixture
def pump(tmp_path: Path) -> DeclaredCase:
    return load_declared_case(write_case(tmp_path, PUMP))


def built(case: DeclaredCase, name: str) -> TabularMDP:
    program = case.combination(name).program
    return tabular(program, explore(program), reward="objective")


def outcomes(
    case: DeclaredCase, name: str, state: tuple[int, int], action: str
) -> dict[tuple[int, int], float]:
    """(level, wear) of the successors of one, with their probabilities."""
    model = built(case, name)
    columns = [model.variable_names.index(one) for one in ("level", "wear")]
    values = model.valuations[:, columns]
    (found,) = np.flatnonzero((values == state).all(axis=1))
    choices = np.flatnonzero(
        (model.choice_state == found) & (model.choice_action == model.action_names.index(action))
    )
    assert len(choices) == 1
    branches = np.flatnonzero(model.branch_choice == choices[0])
    return {
        tuple(values[model.branch_target[branch]].tolist()): float(model.branch_prob[branch])
        for branch in branches
    }


def test_a_name_is_the_own_concern_s_first(pump: DeclaredCase) -> None:
    """`rate` of the capability is 0.5, that of the environment 0.25: wear has 0.5 * 0.25."""
    wears = Fraction(1, 2) * Fraction(1, 4)
    assert outcomes(pump, "dry.small.cheap", (1, 0), "rest") == {
        (1, 0): float(1 - wears),
        (1, 1): float(wears),
    }


def test_an_initial_value_reads_another_concern(pump: DeclaredCase) -> None:
    starts = {name: built(pump, name).num_states for name in ("dry.small.cheap", "dry.large.cheap")}
    # the level stays where it begins, at the size: it can't be drained in the dark
    assert starts == {"dry.small.cheap": 2, "dry.large.cheap": 2}


def test_an_action_that_a_foreign_parameter_forbids_is_lacking(pump: DeclaredCase) -> None:
    assert [one.name for one in pump.combination("dry.small.cheap").capability.external] == ["rest"]
    assert outcomes(pump, "wet.small.cheap", (1, 0), "drain") == {(0, 0): 0.75, (0, 1): 0.25}


def test_rewards_read_every_concern(pump: DeclaredCase) -> None:
    model = built(pump, "wet.large.cheap")
    column = model.variable_names.index("wear")
    worn = model.valuations[model.choice_state, column] == 1
    level = model.valuations[model.choice_state, model.variable_names.index("level")]
    expected = np.where(worn, -2 * 3, level * 0.5)
    np.testing.assert_array_equal(model.choice_reward, expected)


def test_what_is_closed_is_kept(pump: DeclaredCase) -> None:
    """A concern that reads nothing of the objective is the same object under each of them."""
    one, other = pump.combination("wet.large.cheap"), pump.combination("wet.large.cheap")
    assert one.environment is other.environment
    assert one.capability is other.capability


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "level * environment.rate",
            "level * rate",
            "'rate' at column 9 is ambiguous: write environment.rate or capability.rate",
        ),
        ("level * environment.rate", "level * enviroment.rate", "unknown variable 'enviroment.rate'"),
        ("level * environment.rate", "level * environment.size", "unknown variable 'environment.size'"),
        (
            "probability: rate}",
            "probability: price}",
            "environment and capability read nothing of the objective",
        ),
        ("probability: rate}", "probability: objective.price}", "read nothing of the objective"),
        ("wear = new", "wear = dark", "unknown variable 'dark' at column 8; known: "),
        ("shade = light", "shade = new", "unknown variable 'new' at column 9"),
        ("wear = new", "rate = new", "unknown variable 'new'"),
        (
            "set: [{value: worn,",
            "set: [{value: torn,",
            "unknown variable 'torn' at column 1; did you",
        ),
        (
            "initial: size",
            "initial: level",
            "'level' at column 1 can't be read here: parameters alone",
        ),
        ("initial: size", "initial: shade + size * 2", "the initial value of level is 6, allowed is 0..3"),
    ],
)
def test_names_that_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        list(load_declared_case(write_case(tmp_path, replaced(PUMP, old, new))).combinations())
    assert message in caught.value.message
    assert caught.value.source == str(tmp_path / "case.yaml")


def test_two_variables_may_number_one_name_differently(tmp_path: Path) -> None:
    text = replaced(
        PUMP,
        "parameters: {rate: {probability: [0, 1]}, shade: {values: [dark, light]}}",
        "parameters: {rate: {probability: [0, 1]}, shade: {values: [worn, dark, light]}}",
    )
    text = replaced(text, 'requires: "shade = light & level > 0"', 'requires: "shade = worn | wear = worn"')
    case = load_declared_case(write_case(tmp_path, text))
    (_, drain) = case.combination("wet.small.cheap").capability.external
    assert outcomes(case, "wet.small.cheap", (1, 1), "drain") == {(0, 1): 1.0}
    assert drain.name == "drain"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'value: "min(level + 1, size)"',
            'value: "level + size"',
            r"\[rest\] of level makes level 4, allowed is 0..3, in state",
        ),
        (
            "{otherwise: level}",
            '{value: level, probability: "0.9 - rate"}',
            r"wet.large.cheap: the probabilities of \[rest\] of level sum to 0.9, not 1, in state \(.*level=",
        ),
    ],
)
def test_what_only_states_show_names_member_and_state(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    case = load_declared_case(write_case(tmp_path, replaced(PUMP, old, new)))
    with pytest.raises(ModelError, match=message):
        built(case, "wet.large.cheap")
