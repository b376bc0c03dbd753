"""A combination's model by each route, as what can be compared: state by valuation, action by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from merap.concerns.combination import Combination
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import END_ACTION
from merap.program.form import StateVariable
from tests.support.case_enumeration import EnumeratedCase, State

DIGITS = 12

Row = dict[State, tuple[float, float]]


@dataclass(frozen=True)
class ComparedModel:
    """A model as plain Python; probabilities and rewards to twelve digits.

    Attributes:
        initial: state -> probability.
        choices: state -> action -> successor -> (probability, reward).
        labels: name -> the states where it holds.
    """

    initial: dict[State, float]
    choices: dict[State, dict[str, Row]]
    labels: dict[str, frozenset[State]]


def of_enumeration(case: EnumeratedCase) -> ComparedModel:
    """The model by the third route, as it can be compared."""
    choices = {
        state: {
            action: {
                successor: (round(float(chance), DIGITS), round(float(reward), DIGITS))
                for successor, (chance, reward) in row.items()
            }
            for action, row in rows.items()
        }
        for state, rows in case.choices.items()
    }
    initial = {state: round(float(chance), DIGITS) for state, chance in case.initial.items()}
    return ComparedModel(initial, choices, dict(case.labels))


def of_arrays(combination: Combination, model: TabularMDP, names: tuple[str, ...]) -> ComparedModel:
    """The model of arrays, over some of its variables.

    Args:
        combination: whose model it is.
        model: by valuation, completed states with theirs.
        names: of the variables to keep; the others have one value in all states.
    """
    states = _states(combination, model, names)
    choices: dict[State, dict[str, Row]] = {state: {} for state in states}
    for choice in range(model.num_choices):
        action = model.action_names[model.choice_action[choice]]
        if action == END_ACTION:
            continue
        begin, end = model.choice_to_branch[choice : choice + 2]
        row = choices[states[model.choice_state[choice]]].setdefault(action, {})
        for branch in range(begin, end):
            given = (
                model.choice_reward[choice] if model.branch_reward is None else model.branch_reward[branch]
            )
            found = (round(float(model.branch_prob[branch]), DIGITS), round(float(given), DIGITS))
            row[states[model.branch_target[branch]]] = found
    initial = {state: round(float(p), DIGITS) for state, p in zip(states, model.initial, strict=True) if p}
    labels = {
        "complete" if name == "done" else name: frozenset(states[place] for place in mask.nonzero()[0])
        for name, mask in model.labels.items()
    }
    return ComparedModel(initial, choices, labels)


def _states(combination: Combination, model: TabularMDP, names: tuple[str, ...]) -> list[State]:
    declared = {one.name: one for one in combination.program.variables}
    columns = dict(zip(model.variable_names, model.valuations.T.tolist(), strict=True))
    for name in set(columns) - set(names):
        assert len(set(columns[name])) == 1, f"{name} has several values"
    shown = [[_shown(value, declared[name]) for value in columns[name]] for name in names]
    states = list(zip(*shown, strict=True))
    assert len(set(states)) == len(states), "two states have the same values"
    return states


def _shown(value: int, variable: StateVariable) -> Any:
    if variable.kind == "named":
        return variable.values[value]
    return bool(value) if variable.kind == "bool" else value
