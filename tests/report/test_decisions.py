"""Policies as tables: boxes worked out by hand, and every state in exactly one row."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from merap.concerns.combination import Combination
from merap.families.loading import load_case
from merap.families.models import explored
from merap.report.decisions import decisions
from tests.support.process_cases import SERVICE


def service(folder: Path) -> Combination:
    (folder / "case.yaml").write_text(SERVICE, encoding="utf-8")
    return load_case(folder).combination_at(0)


def test_states_with_one_action_are_one_row(tmp_path: Path) -> None:
    combination = service(tmp_path)
    mdp = explored(combination)
    running, load = (mdp.valuations[:, mdp.variable_names.index(name)] for name in ("running", "load"))
    keep, grow, shrink = (mdp.action_names.index(name) for name in ("keep", "grow", "shrink"))
    actions = np.select([running == 4, (running == 1) & (load < 3)], [shrink, grow], keep)
    found = decisions(combination.program, mdp, actions)
    assert found.variables == ("running", "booting", "load", "seen")
    # load 4 has been seen as soon as it is there; nothing boots with four servers
    assert found.rows == (
        ("1", "any", "0..2", "any", "grow"),
        ("1", "any", "3", "any", "keep"),
        ("1..3", "any", "4", "once", "keep"),
        ("2..3", "any", "0..3", "any", "keep"),
        ("4", "0", "0..3", "any", "shrink"),
        ("4", "0", "4", "once", "shrink"),
    )


def test_every_state_is_in_one_row_and_has_its_action(tmp_path: Path) -> None:
    combination = service(tmp_path)
    mdp = explored(combination)
    actions = np.random.default_rng(0).integers(3, size=mdp.num_states)
    found = decisions(combination.program, mdp, actions)
    variables = {one.name: one for one in combination.program.variables}

    def values(name: str, text: str) -> set[str]:
        one = variables[name]
        ends = text.split("..")
        if text == "any":
            return {one.text(value) for value in range(one.low, one.high + 1)}
        return {text} if len(ends) == 1 else {str(value) for value in range(int(ends[0]), int(ends[1]) + 1)}

    columns = [mdp.variable_names.index(name) for name in found.variables]
    for state, action in zip(mdp.valuations[:, columns].tolist(), actions.tolist(), strict=True):
        texts = [variables[name].text(value) for name, value in zip(found.variables, state, strict=True)]
        (row,) = [
            row
            for row in found.rows
            if all(
                own in values(name, cell)
                for own, name, cell in zip(texts, found.variables, row[:-1], strict=True)
            )
        ]
        assert row[-1] == mdp.action_names[action]
