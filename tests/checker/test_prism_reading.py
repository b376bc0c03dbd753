"""PRISM text of others, read into programs; Storm's own build of the text is the other route."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from merap.checker.prism_reading import read_prism
from merap.errors import InputError
from merap.mdp.model import TabularMDP
from merap.prism.program_text import render_program
from merap.program.arrays import tabular
from merap.program.closing import closed
from merap.program.completion import completed, enabled
from merap.program.exploration import explore
from merap.program.expressions import Value, negation, render
from merap.program.form import Program
from merap.program.unique_actions import ambiguous_actions, unique_actions
from tests.support.explored import choices_of
from tests.support.storm_choices import build, choices_of_storm

# features: formulas, renaming, a shared variable, several commands of one
# action, commands without an action, powers, decimals, booleans in comparisons
FEATURES = """\
mdp
const int N = 3;
const double p;
const bool careful;
formula big = x > 1;
global g : [0..2] init 0;
module a
  x : [0..N] init 0;
  b : bool init true;
  [go] x<N & !big -> p/2 : (x'=x+1) & (b'=!b) + 1-p/2 : (x'=max(x-1,0));
  [go] x<N & b & !careful -> (x'=N);
  [] big => (mod(x, 3) = 0) -> (g'=max(0, min(2, ceil(pow(x,2)/3)-floor(1.5))));
  [go] x=N -> true;
  [even] (mod(x, 2) = 0) = b -> 0.1 : (x'=0) + 0.9 : (b'=!b);
endmodule
module c = a [x=y, b=d] endmodule
label "goal" = x=N;
label "mixed" = 0.1*x <= 0.3 | g = 2;
rewards "steps" [go] x>0 : 2.5; true : b?1:0; [] true: 3; endrewards
rewards "plain" x > 0 : x/2; endrewards
"""
# guards, probabilities and values whose right sides are undefined at x = 0 or for n = 0
GUARDED = """\
mdp
const int n;
formula chance = x>1 & 1/x<0.4 ? 1/x : 1/2;
module m
  x : [0..4] init 0;
  [a] x>0 & 10/x>3 -> (x'=x-1);
  [b] x=0 | 10/x<6 -> (x'=min(4, x+1));
  [c] x>0 => mod(8, x)=0 -> chance : (x'=x>2 ? floor(4/x) : x) + 1-chance : (x'=4);
  [d] x<4 | 10/n>2 -> true;
endmodule
label "goal" = x=4;
"""
SEVERAL_STARTS = """\
mdp
module m
  x : [0..5];
  [up] x<5 -> (x'=x+1);
  [end] x=5 -> true;
endmodule
init x < 3 & x != 1 endinit
"""
SKETCH = """\
mdp
hole int step in {1..3};
hole double odds in {0.1, 0.5};
module m
  x : [0..step_MAX] init 0;
  [go] x+step<=step_MAX -> odds : (x'=x+step) + 1-odds : true;
  [rest] x+step>step_MAX -> true;
endmodule
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("prism")


def saved(folder: Path, text: str, name: str = "model.prism") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "values"),
    [
        (FEATURES, {"p": Fraction(1, 3), "careful": True}),
        (FEATURES, {"p": Fraction(1), "careful": False}),
        (SEVERAL_STARTS, {}),
        (GUARDED, {"n": Fraction(3)}),
    ],
)
def test_the_model_is_that_of_storm_and_so_is_the_text_we_write(
    folder: Path, text: str, values: dict[str, Value]
) -> None:
    program = closed(read_prism(saved(folder, text)).program, values)
    constants: dict[str, Any] = {name: str(value).lower() for name, value in values.items()}
    theirs = build(saved(folder, text), constants)
    found = explore(program)
    assert choices_of(program, found) == choices_of_storm(program, theirs)
    again = build(saved(folder, render_program(program), "again.prism"), {})
    assert choices_of_storm(program, again) == choices_of(program, found)
    mdp = without_deadlocks(program)
    for name, where in ((one, theirs.labeling.get_states(one)) for one in program.labels if one != "mixed"):
        assert int(mdp.labels[name].sum()) == len(list(where))


def without_deadlocks(program: Program, reward: str | None = None) -> TabularMDP:
    split = unique_actions(program, ambiguous_actions(explore(program)))
    repaired = completed(split, negation(enabled(split)), "last")
    return tabular(repaired, explore(repaired), reward=reward)


def test_rewards_of_states_and_actions_add_up(folder: Path) -> None:
    program = closed(read_prism(saved(folder, FEATURES)).program, {"p": Fraction(1, 3), "careful": False})
    mdp = without_deadlocks(program, "steps")
    assert {"even", "a#1", "c#1", "go#1.1", "go#2.1", "go#3.3"} <= set(mdp.action_names)
    names = [mdp.action_names[action] for action in mdp.choice_action]
    columns = {name: mdp.valuations[:, place] for place, name in enumerate(mdp.variable_names)}
    for choice, name in enumerate(names):
        state = mdp.choice_state[choice]
        at_state = 1 if columns["b"][state] else 0
        of_go = 2.5 if name.startswith("go") and columns["x"][state] > 0 else 0
        alone = 3 if name in ("a#1", "c#1") else 0
        assert mdp.choice_reward[choice] == pytest.approx(at_state + of_go + alone)


def test_mod_of_a_negative_number_is_prisms_and_not_storms(folder: Path) -> None:
    # Storm gives 3 for mod(-3, 3), so its own build of such a text has another state
    text = "mdp\nmodule m\n x : [-3..3] init -3;\n [a] true -> (x'=mod(x, 3));\nendmodule\n"
    program = read_prism(saved(folder, text)).program
    assert choices_of(program, explore(program))[(-3,)] == Counter({("a", frozenset({((0,), 1.0)})): 1})
    again = build(saved(folder, render_program(program), "again.prism"), {})
    assert choices_of_storm(program, again) == choices_of(program, explore(program))


def test_holes_are_parameters(folder: Path) -> None:
    program = closed(read_prism(saved(folder, SKETCH)).program, {"step": Fraction(2), "odds": Fraction(1, 2)})
    assert explore(program).encoding.valuations(explore(program).codes).tolist() == [[0], [2]]


def test_a_parameter_without_a_value_is_named(folder: Path) -> None:
    program = closed(read_prism(saved(folder, SKETCH)).program, {"odds": Fraction(1, 2)})
    with pytest.raises(KeyError, match="step"):
        explore(program)


@pytest.mark.parametrize(
    ("text", "line", "complaint"),
    [
        ("dtmc\nmodule m\n x : bool;\nendmodule", 1, "the model is of type dtmc, only mdp is supported"),
        ("module m\n x : bool;\nendmodule", 1, "the type of the model is missing"),
        ("mdp\nmodule m\n x : int;\nendmodule", 3, "a variable without bounds"),
        (
            "mdp\nmodule m\n x : bool;\n [] true -> [0.6,0.7] : true + [0.3,0.4] : (x'=true);\nendmodule",
            4,
            "interval",
        ),
        ("mdp\nmodule m\n x : clock;\nendmodule", 3, "clocks are not supported"),
        ("mdp\nmodule m\n x : bool;\nendmodule\nsystem m endsystem", 5, "`system ... endsystem`"),
        ("mdp\nmodule m\n x : bool;\n [] tru -> true;\nendmodule", 4, "tru"),
        ("mdp\nmodule m\n x : [0..2] init 0;\n [] x>> -> true;\nendmodule", 4, "error"),
        (
            "mdp\nmodule m\n x : [0..2] init 0;\nendmodule\ninit x=1 endinit",
            3,
            "Error for m.x: illegal to specify initial value",
        ),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(
    folder: Path, text: str, line: int, complaint: str
) -> None:
    path = saved(folder, text)
    with pytest.raises(InputError) as caught:
        read_prism(path)
    assert complaint in str(caught.value)
    assert str(caught.value).startswith(f"{path}:{line}: ")
    assert len(str(caught.value).splitlines()) == 1


def test_a_shared_variable_is_not_written_by_an_action(folder: Path) -> None:
    text = "mdp\nglobal g : bool;\nmodule m\n x : bool;\n [a] true -> (g'=x);\nendmodule"
    with pytest.raises(InputError, match=r"the global variable g is written by a command with an action"):
        read_prism(saved(folder, text))


def test_what_a_text_leaves_open_has_types_and_the_rest_has_definitions(folder: Path) -> None:
    text = """mdp
const int n; const double p; const bool careful; const int unread;
const int twice = 2*n; const double q = 1-p;
formula far = x > twice; formula careless = far & !careful;
module m
  x : [0..9] init 0;
  [a] !careless -> p : (x'=n) + q : true;
endmodule
"""
    model = read_prism(saved(folder, text))
    assert model.constants == {"n": "int", "p": "double", "careful": "bool", "unread": "int"}
    shown = {name: render(value) for name, value in model.definitions.items()}
    assert shown == {
        "twice": "2 * n",
        "q": "1 - p",
        "far": "x > 2 * n",
        "careless": "x > 2 * n & !careful",
    }
