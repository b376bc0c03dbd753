"""Processes in case files: what they mean, and what is refused, with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.combination_model import build_combination
from merap.concerns.case_study import load_declared_case
from merap.concerns.combination import DeclaredCombination
from merap.concerns.composition import compose
from merap.errors import InputError
from merap.mdp.comparison import compare
from merap.mdp.model import TabularMDP
from merap.mdp.planning import optimum
from merap.program.arrays import tabular
from merap.program.exploration import explore
from tests.support.case_examples import write_case
from tests.support.process_cases import SERVICE


def explored(combination: DeclaredCombination) -> TabularMDP:
    program = compose(combination)
    return tabular(program, explore(program), reward="objective")


@pytest.mark.parametrize(
    # by PRISM text written by hand, on which Storm and PRISM-games agree
    ("member", "best"),
    [("rush.fast.quality", -114.531431), ("calm.slow.thrift", -34.425167)],
)
def test_the_best_return_of_a_service(tmp_path: Path, member: str, best: float) -> None:
    case = load_declared_case(write_case(tmp_path, SERVICE))
    assert case.warnings == ()
    combination = case.combination(member)
    mdp = explored(combination)
    assert optimum(mdp, horizon=30) == pytest.approx(best, abs=1e-6)
    compare(build_combination(combination).mdp, mdp).require_same()


def test_a_monitor_sees_what_the_load_becomes(tmp_path: Path) -> None:
    mdp = explored(load_declared_case(write_case(tmp_path, SERVICE)).combination("rush.fast.quality"))
    column = {name: mdp.valuations[:, place] for place, name in enumerate(mdp.variable_names)}
    assert np.all(column["seen"][column["load"] == 4] == 1)
    assert np.array_equal(mdp.labels["unsafe"], (column["seen"] == 1) & (column["running"] < 2))
    seen = column["seen"] == 1
    assert np.all(seen[mdp.branch_target[seen[mdp.choice_state[mdp.branch_choice]]]])


def test_initial_values_may_be_drawn(tmp_path: Path) -> None:
    text = SERVICE.replace(
        "      initial: 1\n", "      initial: [{value: 0, probability: up}, {otherwise: 2}]\n", 1
    )
    mdp = explored(load_declared_case(write_case(tmp_path, text)).combination("calm.slow.thrift"))
    load = mdp.valuations[:, mdp.variable_names.index("load")]
    assert {(int(load[state]), float(mdp.initial[state])) for state in np.flatnonzero(mdp.initial)} == {
        (0, 0.1),
        (2, 0.9),
    }


@pytest.mark.parametrize(
    ("old", "new", "place", "complaint"),
    [
        ("range: [0, 4]", "range: [4, 0]", "load.range", r"expected \[least, greatest\]"),
        (
            "range: [0, 4]",
            "range: [0, 4]\n      type: bool",
            "load",
            "give exactly one of range, type and values",
        ),
        ("      initial: 1\n", "", "load", "missing key 'initial'"),
        (
            "      initial: 1\n",
            "      initial: 7\n",
            "load",
            "the initial value of load is 7, allowed is 0..4",
        ),
        (
            "      initial: 1\n",
            "      initial: [{value: 1, probability: 0.5}]\n",
            "load",
            "sum to 0.5, not 1",
        ),
        ("probability: up}", "probability: upp}", "set", "unknown variable 'upp'"),
        ("probability: up}", "chance: up}", "set", "expected the keys value and probability"),
        (
            "{otherwise: load}",
            "{otherwise: load}\n            - {otherwise: 1}",
            "set",
            "otherwise stands twice",
        ),
        ("action: grow", "action: grows", "changes", "unknown action 'grows'; did you mean 'grow'"),
        ("set: {booting: 1}", "set: {boot: 1}", "set", "unknown variable 'boot' of the process"),
        ("set: {booting: 1}", "set: 1", "set", "give values by name: running, booting"),
        (
            "set: {booting: 1}",
            'set: {booting: "seen\' = once ? 1 : 0"}',
            "set.booting",
            "read nothing of the objective",
        ),
        (
            'value: "min(load + 1, 4)"',
            'value: "min(load + running\', 4)"',
            "processes.load.changes[0]",
            "reads what running becomes, which is declared later",
        ),
        (
            'where: "booting = 1"',
            'where: "running\' = 1"',
            "processes.servers.changes[2]",
            "can't read what it becomes itself: running'",
        ),
        (
            'changes: [{where: "load\' = 4"',
            'changes: [{where: "seen\' = once"',
            "processes.seen.changes[0]",
            "can't read what it becomes itself: seen'",
        ),
        ("set: {booting: 1}", "set: {booting: true}", "booting", "is a bool, expected a number"),
        ("set: once}", "set: twice}", "set", "unknown variable 'twice'"),
        ("set: once}", "set: [{value: once, probability: 0.5}, {otherwise: never}]}", "set", "it can't draw"),
        (
            "running > 1",
            "runing > 1",
            "requires",
            "unknown variable 'runing' at column 1; did you mean 'running'",
        ),
        (
            "running > 1",
            "seen = once",
            "requires",
            "environment and capability read nothing of the objective",
        ),
        ("    servers:", "    load:", "load", "the environment has a process of that name"),
        ("values: [never, once]", "values: [never, never]", "seen", "a value of seen stands twice"),
        (
            "parameters: {boot: probability}",
            "parameters: {running: probability}",
            "running",
            "a variable already",
        ),
        ("        running: {", "        mode: {", "servers", "illegal name 'mode' of a variable"),
        (
            "changes:\n        - set:",
            "chnges:\n        - set:",
            "load",
            "unknown key 'chnges'; did you mean 'changes'",
        ),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(
    tmp_path: Path, old: str, new: str, place: str, complaint: str
) -> None:
    assert old in SERVICE
    with pytest.raises(InputError, match=complaint) as caught:
        load_declared_case(write_case(tmp_path, SERVICE.replace(old, new, 1)))
    line = str(caught.value)
    assert "\n" not in line
    assert place in line
