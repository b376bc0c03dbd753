from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.combination_model import build_combination
from merap.checker.storm import build_text
from merap.checker.storm_messages import UnsupportedPropertyError, translate
from merap.checker.storm_model import StormModel
from merap.concerns.combination import Combination
from merap.errors import EngineError, InputError, MerapError
from merap.families.models import explored
from merap.mdp.comparison import compare
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.umb import read_umb
from tests.support.hand_made import cells, graph_combination, grid_combination, with_objective
from tests.support.random_combinations import random_combination
from tests.support.walk import WALK


@pytest.fixture(scope="module")
def walk() -> StormModel:
    return build_text(WALK, "walk")


@pytest.fixture(autouse=True)
def _storm_is_silent(capfd: pytest.CaptureFixture[str]):  # type: ignore[no-untyped-def]
    yield
    assert capfd.readouterr() == ("", "")


# --- values ---


def test_probabilities_have_bounds_that_enclose_the_closed_form(walk: StormModel) -> None:
    # three successes within four tries: 1/8 + 3/16
    within_four = walk.check('Pmax=? [F<=4 "goal"]')
    assert within_four.value == 5 / 16
    assert within_four.lower is not None
    assert within_four.upper is not None
    assert within_four.lower <= 5 / 16 <= within_four.upper
    assert within_four.holds is None
    assert walk.check('Pmin=? [F "goal"]').value == 0
    assert walk.check('Pmax=? [F "goal"]').value == pytest.approx(1, abs=1e-9)


def test_rewards_of_any_sign_over_a_bounded_number_of_steps(walk: StormModel) -> None:
    assert walk.check('R{"objective"}min=? [C<=2]').value == -1
    # to rest is best while three steps cost 3/2 and bring 3 with 1/8
    assert walk.check('R{"objective"}max=? [C<=4]').value == 0
    # discounted by 0.9 a step: -(1 + 0.9)/2
    assert walk.check('R{"objective"}min=? [C<=2discount=0.9]').value == pytest.approx(-0.95)
    # nothing is below 0 here: geometric, 2 steps for each success
    assert walk.check('R{"steps"}min=? [F "goal"]').value == pytest.approx(6, abs=1e-9)


def test_a_bound_gives_a_truth_value_and_the_value_itself(walk: StormModel) -> None:
    missed = walk.check('Pmax>=0.5 [F<=4 "goal"]')
    assert (missed.holds, missed.value) == (False, 5 / 16)
    kept = walk.check('Pmax>=0.25 [F<=4 "goal"]')
    assert (kept.holds, kept.value) == (True, 5 / 16)
    # of all policies: the least for >=, the greatest for <=
    assert walk.check('P>=0.25 [F<=4 "goal"]').holds is False
    assert walk.check('P>=0.25 [F<=4 "goal"]').value == 0
    assert walk.check('P<=0.25 [F<=4 "goal"]').value == 5 / 16
    assert walk.check('R{"objective"}max>=-1 [C<=4]').holds is True


def test_a_truth_value_alone_has_no_value(walk: StormModel) -> None:
    answer = walk.check('"goal" | Pmax>=0.25 [F<=4 "goal"]')
    assert (answer.holds, answer.value, answer.lower, answer.upper) == (True, None, None, None)


def test_a_value_without_sound_bounds_says_so(walk: StormModel) -> None:
    answer = walk.check('LRAmax=? ["goal"]')
    assert answer.value == pytest.approx(1, abs=1e-6)
    assert (answer.lower, answer.upper) == (None, None)


def test_an_infinite_value_is_infinite(walk: StormModel) -> None:
    assert walk.check('R{"steps"}max=? [F "goal"]').value == np.inf


def test_several_initial_states_are_weighted() -> None:
    text = WALK.replace(" init 0", "") + "init x<=1 endinit\n"
    model = build_text(text, "walk")
    mdp = model.mdp()
    within_two = 'Pmax=? [F<=2 "goal"]'
    # from x=1 with 1/4, from x=0 not at all
    assert model.check(within_two).value == 1 / 8
    weights = np.where(mdp.valuations[:, 0] == 1, 0.9, 0.1) * (mdp.valuations[:, 0] <= 1)
    assert model.check(within_two, weights).value == pytest.approx(0.9 / 4)
    # a truth value is about every initial state
    assert model.check('Pmax>0 [F<=2 "goal"]').holds is False
    assert model.check('Pmax>0 [F<=3 "goal"]').holds is True


def dense_optimum(mdp: TabularMDP, horizon: int, discount: float) -> float:
    """Backward induction on dense tables with a loop over states: the slow, plain way."""
    transition_A_S_S = np.zeros((mdp.num_actions, mdp.num_states, mdp.num_states))
    reward_A_S = np.full((mdp.num_actions, mdp.num_states), -np.inf)
    for state in range(mdp.num_states):
        for choice in range(mdp.state_to_choice[state], mdp.state_to_choice[state + 1]):
            action = mdp.choice_action[choice]
            reward_A_S[action, state] = mdp.choice_reward[choice]
            for branch in range(mdp.choice_to_branch[choice], mdp.choice_to_branch[choice + 1]):
                transition_A_S_S[action, state, mdp.branch_target[branch]] = mdp.branch_prob[branch]
    values: Floats = np.zeros(mdp.num_states)
    for _ in range(horizon):
        values = (reward_A_S + discount * transition_A_S_S @ values).max(axis=0)
    return float(mdp.initial @ values)


OPTIMA = {
    "grid": grid_combination(),
    "obstacles": grid_combination(blocked=cells((1, 2), (3, 2), (4, 1), (6, 1)), no_entry=cells((4, 3))),
    "graph": graph_combination(),
    **{f"random {seed}": random_combination(seed) for seed in range(100, 116)},
}


@pytest.mark.parametrize("name", OPTIMA)
def test_the_optimum_equals_backward_induction(name: str) -> None:
    combination = OPTIMA[name]
    horizon, discount = combination.objective.horizon, combination.discount
    built = build_combination(combination)
    expected = dense_optimum(explored(combination), horizon, discount)
    suffix = "" if discount == 1 else f"discount={discount}"
    answer = built.storm.check(f'R{{"objective"}}max=? [C<={horizon}{suffix}]', built.mdp.initial)
    assert answer.value == pytest.approx(expected, abs=1e-6)


# --- export ---


def test_the_archive_holds_the_model(walk: StormModel, tmp_path: Path) -> None:
    walk.export_umb(tmp_path / "walk.umb")
    compare(read_umb(tmp_path / "walk.umb"), walk.mdp()).require_same()
    mdp = walk.mdp()
    assert mdp.variable_names == ("x",)
    assert sorted(mdp.action_names) == ["end", "go", "rest"]
    assert mdp.labels["goal"].tolist() == (mdp.valuations[:, 0] == 3).tolist()


def test_a_model_is_exported_once_for_all_that_it_is_used_for(monkeypatch: pytest.MonkeyPatch) -> None:
    exported = []
    export = StormModel.export_umb

    def counted(model: StormModel, path: Path) -> None:
        exported.append(path)
        export(model, path)

    monkeypatch.setattr(StormModel, "export_umb", counted)
    combination = graph_combination()
    built = build_combination(combination)
    built.storm.check('R{"objective"}max>=-100 [C<=3]', built.mdp.initial)
    built.storm.mdp()
    assert len(exported) == 1


def test_reward_structures_are_chosen_by_name(walk: StormModel) -> None:
    assert set(walk.mdp().choice_reward.tolist()) == {-0.5, 0, 3}
    assert set(walk.mdp("steps").choice_reward.tolist()) == {0, 1}
    assert not walk.mdp(None).choice_reward.any()
    with pytest.raises(InputError, match="no reward structure 'cost'"):
        walk.mdp("cost")


def test_an_archive_cannot_be_written_where_there_is_no_folder(walk: StormModel, tmp_path: Path) -> None:
    with pytest.raises(EngineError, match=r"^walk: "):
        walk.export_umb(tmp_path / "missing" / "walk.umb")


def test_weights_of_start_locations_reach_the_arrays() -> None:
    start = np.array([0.125, 0, 0.5, 0.375])
    combination = with_objective(graph_combination(), start=start)
    mdp = build_combination(combination).mdp
    weights = np.zeros(4)
    weights[mdp.valuations[mdp.initial > 0, mdp.variable_names.index("loc")]] = mdp.initial[mdp.initial > 0]
    assert weights.tolist() == start.tolist()


# --- properties that are refused ---


WRONG = [
    ('Pmax=? [F "gaol"]', "unknown label 'gaol'; did you mean 'goal'?"),
    ('Pmax=? [F "goal"', "syntax error at column 17, at the end"),
    ("Pmax=? [F ", "syntax error at column 11, at the end"),
    ("Pmax=? [F y=2]", "unknown variable 'y' at column 11; known: x"),
    ("Pmax=? [F x]", "a number stands where a truth value is expected"),
    ('P=? [F "goal"]', "an MDP has a value for each policy: ask for the least or greatest, as Pmax=?"),
    ('R{"cost"}max=? [C<=3]', "unknown reward model 'cost'; known: objective, steps"),
    ("R{3}max=? [C<=3]", "the model has 2 reward structures"),
    ("Pmax=? [F<=x x=2]", "a number of steps reads 'x', which is no constant"),
    ("Pmax=? [F<=0.5 x=2]", "1/2 is no whole number of steps"),
    ("Pmax=? [F[3,2] x=2]", "a bound on time leaves no step"),
    ("Pmax=? [F<0 x=2]", "a bound on time leaves no step"),
    ("filter(state, Pmax=? [F x=3], x<2)", "the filter asks for one state, and 2 are meant"),
    ("filter(min, Pmax=? [F x=3], x<0)", "no state is one that the filter asks for"),
    ('Pmax=? [F "goal"]; Pmin=? [F "goal"]', "holds 2 properties, expected 1"),
    ("// nothing", "holds 0 properties, expected 1"),
    ('const int k; Pmax=? [F<=k "goal"]', "constant 'k' has no value"),
]
UNSUPPORTED = [
    ("filter(print, Pmax=? [F x=3])", "filter(print, ..) is not supported; expected one of min, max"),
    ("E [G x<3]", "E of a path without end is not supported"),
    ("E [x<3 W x=3]", "E of a path without end is not supported"),
    ('R{"steps"}max=? [x<2 U x=3]', "rewards of this path"),
    ("pow(Pmax=? [F x=3], 2)", "pow(..) of a value that is computed is not supported"),
    ("Pmax=? [F>=2 (F>=3 x=2)]", "a bound on time around another path formula"),
    ('multi(Pmax=? [F "goal"], Pmax=? [F "deadlock"])', "Storm has no single value for it"),
    ('R{"objective"}min=? [F "goal"]', "rewards 'objective' are below 0 somewhere"),
    ('R{"objective"}max>=0 [C]', "rewards 'objective' are below 0 somewhere"),
]


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [(InputError, *row) for row in WRONG] + [(UnsupportedPropertyError, *row) for row in UNSUPPORTED],
)
def test_a_property_is_refused_in_one_line(
    walk: StormModel, kind: type[MerapError], text: str, message: str
) -> None:
    with pytest.raises(MerapError) as raised:
        walk.check(text)
    assert type(raised.value) is kind
    assert str(raised.value).startswith(f"walk: property {text!r}: {message}")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("raised", "kind", "message"),
    [
        ("NotSupportedException: No.\n", UnsupportedPropertyError, "m: No"),
        ("NotImplementedException: Not yet.", UnsupportedPropertyError, "m: Not yet"),
        ("UnexpectedException: Oh\n\tno.", EngineError, "m: Oh no"),
        ("something else", EngineError, "m: something else"),
    ],
)
def test_other_failures_are_the_engine_s(raised: str, kind: type[MerapError], message: str) -> None:
    error = translate(raised, "m", InputError, None)
    assert type(error) is kind
    assert str(error) == message
    assert error.exit_code == 3


def test_the_case_at_hand_is_checked_as_it_stands() -> None:
    combination: Combination = graph_combination()
    built = build_combination(combination)
    assert built.storm.source == "e.c.o"
    assert built.storm.check('Pmax=? [F "unsafe"]', built.mdp.initial).value == pytest.approx(1, abs=1e-9)
