"""What is wrong with a family of PRISM text is said in one line with its place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from merap.errors import InputError
from merap.families.loading import load_case
from tests.support.prism_families import WALK, WALK_CASE, write_case

Change = Callable[[str], str]


def swapped(old: str, new: str) -> Change:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return change


# place and message; the text of the case, or that of the model, is changed
OF_CASE = [
    ("file: walk.prism", "file: w.prism", "w.prism: can't be read: No such file or directory"),
    ("top: {int: [3, 5]}, ", "", "case.yaml:7: environment.configurations.near.top: unknown parameter 'top'"),
    (
        "lazy: bool",
        "lazy: bool, lazi: bool",
        "case.yaml:11: capability.configurations.generate: the parameter 'lazi' has no value",
    ),
    (
        "{lazy: bool}",
        "{lazy: {int: [0, 1]}}",
        "capability.parameters.lazy: the constant 'lazy' is of type bool, a parameter of type int does not",
    ),
    (
        "{lazy: bool}",
        "{lazy: locations}",
        "capability.parameters.lazy: a case without space has no parameters of type locations",
    ),
    (
        "objective: {limit: 7}}",
        "objective: {limit: 7}, start: x}",
        "online.met.start: a case without space has no start",
    ),
    (
        "program: {file",
        "program: {constants: {top: 4}, file",
        "environment.parameters.top: 'top' has a value in program.constants too",
    ),
    (
        "program: {file",
        "program: {constants: {tip: 4}, file",
        "program.constants.tip: the text has no constant 'tip'; did you mean 'top'?",
    ),
    (
        "[timer]",
        "[time]",
        "program.owner.capability: the text has no module 'time'; did you mean 'timer'?",
    ),
    (
        "capability: [timer]",
        "capability: [timer], environment: [timer]",
        "the module 'timer' is claimed by capability and environment",
    ),
    ("reward: cost", "reward: costs", "objective.reward: the text has no reward structure 'costs'; did you"),
    ("sign: -1", "sign: -2", "objective.sign: expected 1 or -1, got -2"),
    ("reward: cost", "rewards: []", "objective.sign: sign goes with reward"),
    ("horizon: limit", "horizon: slip", "objective.horizon: expected a number, or a parameter of type int"),
    ("unsafe: home & late", "unsafe: homes", "objective.unsafe: unknown variable 'homes' at column 1"),
    ("unsafe: home & late", "unsafe: x", "objective.unsafe: 'x' is a number, expected a bool"),
    ("unsafe: home & late", "unsafe: at(home)", "objective.unsafe: "),
    (
        """goal: '"goal"'""",
        """goal: '"gaol"'""",
        """objective.goal: unknown label "gaol" at column 1; did you mean '"goal"'?""",
    ),
    (
        "  reward: cost\n  sign: -1\n",
        "  rewards: [{action: goo, value: 1}]\n",
        "objective.rewards[0].action: unknown action 'goo'; did you mean",
    ),
    (
        "program: {file: walk.prism, owner: {capability: [timer]}}",
        "program: {}",
        "program: expected either file or templates",
    ),
    ("discount: 0.9", "discount: 0.9\nspace: {}", "space: unknown key 'space'"),
    (
        "  parameters: {limit: int}",
        "  parameters: {limit: int, rate: real}",
        "objective.configurations.short: the parameter 'rate' has no value",
    ),
]
OF_TEXT = [
    ("const double slip;", "const double slip", "walk.prism:5: "),
    ("mdp\n", "dtmc\n", "walk.prism:1: the model is of type dtmc, only mdp is supported"),
    ("x : [0..top] init 1", "x : int init 1", "walk.prism:8: a variable without bounds is not supported"),
    ("1-slip :", "[0.1,0.2] :", "walk.prism:9: interval probabilities are not supported"),
    ('label "goal"', 'system walker || timer endsystem\nlabel "goal"', "walk.prism:21: a `system"),
    (
        "const bool lazy;",
        "const bool lazy; const int n;",
        "walk.prism: the constant 'n' has no value: declare",
    ),
    ("const bool lazy;", "const bool lazy = true;", "capability.parameters.lazy: 'lazy' has a meaning in"),
    (
        "1-slip :",
        "0.9-slip :",
        "case.yaml: near.lazy_false.short: the probabilities of [go] in module walker",
    ),
    ("(x'=x+1)", "(x'=x+4)", "case.yaml: near.lazy_false.short: [go] in module walker makes x 4, allowed is"),
]


def refusal(folder: Path, case: str, text: str) -> str:
    path = write_case(folder, case, walk=text)
    with pytest.raises(InputError) as caught:
        load_case(path)
    line = str(caught.value)
    assert len(line.splitlines()) == 1
    return line.replace(f"{folder}/", "")


@pytest.mark.parametrize(("old", "new", "message"), OF_CASE)
def test_a_wrong_case_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert message in refusal(tmp_path, swapped(old, new)(WALK_CASE), WALK)


@pytest.mark.parametrize(("old", "new", "message"), OF_TEXT)
def test_a_wrong_text_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert message in refusal(tmp_path, WALK_CASE, swapped(old, new)(WALK))


def test_a_state_without_action_is_named(tmp_path: Path) -> None:
    text = "mdp\nmodule m\n  x : [0..2];\n  [up] x<2 -> (x'=x+1);\nendmodule\n"
    case = "case: up\nprogram: {file: walk.prism}\nobjective: {horizon: 3, ends_in: x = 1 & false}\n"
    assert refusal(tmp_path, case, text) == (
        "case.yaml: default.default.default: state (x=2) can be reached, is not complete and has no action; "
        "where that ends the task, write ends_in: '\"deadlock\"'"
    )


def test_a_fault_of_a_family_that_is_not_enumerated_is_found_in_a_sample(tmp_path: Path) -> None:
    case = WALK_CASE.replace(
        "configurations:\n    near: {top: 3, slip: 0.25}\n    far: {top: 5, slip: 0.1}",
        "configurations: {generate: {top: {from: all}, slip: {from: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]}}}",
    )
    message = refusal(tmp_path, case, WALK.replace("1-slip", "1-slip*slip"))
    assert message.endswith("in state (x=1, late=false) (found in 1 of 72 combinations)")
