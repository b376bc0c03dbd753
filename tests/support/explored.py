"""What an exploration has found, as plain Python, to compare with other routes."""

from __future__ import annotations

from collections import Counter

from merap.program.exploration import Exploration
from merap.program.form import Program
from tests.support.program_enumeration import State

Choices = dict[State, Counter[tuple[str | None, frozenset[tuple[State, float]]]]]


def states_of(program: Program, exploration: Exploration) -> dict[int, State]:
    rows = exploration.encoding.valuations(exploration.codes).tolist()
    kinds = [one.kind for one in program.variables]
    return {
        code: tuple(bool(value) if kind == "bool" else value for value, kind in zip(row, kinds, strict=True))
        for code, row in zip(exploration.codes.tolist(), rows, strict=True)
    }


def choices_of(program: Program, exploration: Exploration) -> Choices:
    """Return the choices of each state, a distribution as a set of pairs; probabilities to twelve digits."""
    named = states_of(program, exploration)
    found: dict[tuple[int, int], dict[State, float]] = {}
    branches = exploration.branches
    columns = (branches.source, branches.choice, branches.target, branches.prob)
    for source, choice, target, prob in zip(*(column.tolist() for column in columns), strict=True):
        successors = found.setdefault((source, choice), {})
        successors[named[target]] = successors.get(named[target], 0) + prob
    result: Choices = {state: Counter() for state in named.values()}
    for (source, choice), successors in found.items():
        label = exploration.choices[choice]
        pairs = frozenset((state, round(prob, 12)) for state, prob in successors.items())
        result[named[source]][label.action if label.labelled else None, pairs] += 1
    return result
