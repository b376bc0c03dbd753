"""The way a policy takes: the likeliest one, told by the names and values of variables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, takewhile
from typing import Literal, TypeAlias

import numpy as np

from merap.concerns.combination import Combination
from merap.errors import ModelError
from merap.families.models import explored
from merap.mdp.matching import match_rows
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, GOAL_LABEL
from merap.program.expressions import Constant
from merap.program.form import Program
from merap.report.diagrams import told_variables

Ending: TypeAlias = Literal["completed", "ended", "loop", "open"]

_NOTES: dict[Ending, str] = {
    "completed": "(done)",
    "ended": "(ended)",
    "loop": "(loop)",
    "open": "(not completed)",
}


@dataclass(frozen=True)
class RoutePath:
    """T steps through the states of a combination.

    Attributes:
        places: T + 1 names of locations; empty texts where there is no space.
        changes: T + 1 texts: the values of all other variables at first, then those that a step changed.
        actions: T names of actions.
        ending: the task was completed; or it ended where no goal is; or it would go round for ever; or
            nothing of that is known.
        label: its name in a legend.
    """

    places: tuple[str, ...]
    changes: tuple[str, ...]
    actions: tuple[str, ...]
    ending: Ending
    label: str = "path"

    @property
    def completed(self) -> bool:
        """Whether the task was completed."""
        return self.ending == "completed"

    @property
    def text(self) -> str:
        """One line, such as `dock, battery=2 [pick: stage=loaded] -east-> hall, battery=1 (drop)`.

        Arrows move, brackets stay (or a move was blocked or failed), the parentheses at the end hold the
        action that completed the task, or how else it ended. Values follow that a step changed.
        """
        return " ".join([_joined(self.places[0], self.changes[0]), *self._steps_as_text()])

    def _steps_as_text(self) -> Iterator[str]:
        ways = zip(self.actions, self.places, self.places[1:], self.changes[1:], strict=False)
        steps = [
            f"-{action}-> {_joined(there, changes)}"
            if here != there
            else f"[{_joined(action, changes, ': ')}]"
            for action, here, there, changes in ways
        ]
        closing = _NOTES[self.ending]
        if self.ending in {"completed", "ended"} and steps and steps[-1].startswith("["):
            closing = f"({steps.pop()[1:-1]})"
        for step, repeats in groupby(steps):
            count = sum(1 for _ in repeats)
            yield step if count == 1 else f"{step[:-1]} x{count}]"
        yield closing


def _joined(first: str, second: str, separator: str = ", ") -> str:
    return separator.join(filter(None, (first, second)))


def most_likely_path(
    mdp: TabularMDP, combination: Combination, policy: Floats, horizon: int, label: str = "path"
) -> RoutePath:
    """Follow a policy from the likeliest start: always the likeliest action and outcome.

    An outcome that stays in the state is followed only if there is no other: a stationary
    policy then simply tries again. Under a policy by time it is followed where it is the likeliest, for as
    many steps as it takes on average to leave.

    Args:
        mdp: whose states and actions index the policy; completed states need none.
        combination: the one to follow it in, explored here.
        policy: float [S, A], or float [T, S, A] by time t.
        horizon: T, the most steps to follow.
        label: for the legend.

    Raises:
        ModelError: the policy has another shape, or the path comes to a state that it does not know.
    """
    _check_shape(mdp, policy, horizon)
    program = combination.program
    whole = explored(combination)
    states, actions, ending = _follow(whole, _Lookup(mdp, whole, policy), horizon)
    if ending == "completed" and _has_goal(program) and not whole.labels[GOAL_LABEL][states[-1]]:
        ending = "ended"
    valuations = whole.valuations[states].tolist()
    return RoutePath(
        places=tuple(_place(program, valuation) for valuation in valuations),
        changes=tuple(_changes(program, valuations)),
        actions=tuple(whole.action_names[action] for action in actions),
        ending=ending,
        label=label,
    )


def _check_shape(mdp: TabularMDP, policy: Floats, horizon: int) -> None:
    expected: tuple[int, ...] = (mdp.num_states, mdp.num_actions)
    if policy.ndim == 3:
        expected = (horizon, *expected)
    if policy.shape != expected:
        raise ModelError(f"the policy has shape {policy.shape}, not {expected}")


class _Lookup:
    """The rows of a policy, found by valuation, for the states of another model."""

    def __init__(self, mdp: TabularMDP, whole: TabularMDP, policy: Floats) -> None:
        self.stationary = policy.ndim == 2
        self._mdp, self._whole = mdp, whole
        self._policy = policy[None] if self.stationary else policy
        going = np.flatnonzero(~mdp.labels[COMPLETE_LABEL])
        names = [name for name in mdp.variable_names if name in whole.variable_names]
        theirs, ours = (one.valuations[:, _columns(one, names)] for one in (mdp, whole))
        self._row = np.append(going, -1)[match_rows(ours, theirs[going])]
        self._known = np.isin(whole.action_names, mdp.action_names)
        columns = {name: column for column, name in enumerate(mdp.action_names)}
        self._column = [columns.get(name, 0) for name in whole.action_names]

    def action(self, state: int, time: int) -> int:
        """Return the likeliest of the actions that are enabled."""
        if self._row[state] < 0:
            values = zip(self._whole.variable_names, self._whole.valuations[state].tolist(), strict=True)
            raise ModelError(f"the policy does not know ({', '.join(f'{n}={v}' for n, v in values)})")
        row = self._policy[0 if self.stationary else time, self._row[state]]
        chances = np.where(self._known, row[self._column], 0)
        return int(np.where(self._whole.enabled[state], chances, -1).argmax())


def _columns(mdp: TabularMDP, names: list[str]) -> list[int]:
    return [mdp.variable_names.index(name) for name in names]


def _follow(whole: TabularMDP, policy: _Lookup, horizon: int) -> tuple[list[int], list[int], Ending]:
    """Walk: return states [T + 1], actions [T], and how it ends."""
    complete = whole.labels[COMPLETE_LABEL]
    states, actions = [int(whole.initial.argmax())], list[int]()
    while not complete[states[-1]]:
        if len(actions) == horizon:
            return states, actions, "open"
        here = states[-1]
        actions.append(policy.action(here, len(actions)))
        waited = 0 if policy.stationary else sum(1 for _ in takewhile(here.__eq__, reversed(states)))
        states.append(_likeliest_successor(whole, here, actions[-1], waited))
        if policy.stationary and states[-1] in states[:-1]:
            return states, actions, "loop"
    return states, actions, "completed"


def _likeliest_successor(mdp: TabularMDP, state: int, action: int, waited: int) -> int:
    """Return where a step leads after so many steps in the state; 0: it is not stayed in."""
    first, end = mdp.state_to_choice[state : state + 2]
    choice = first + int(np.flatnonzero(mdp.choice_action[first:end] == action)[0])
    branches = slice(*mdp.choice_to_branch[choice : choice + 2])
    targets, prob = mdp.branch_target[branches], mdp.branch_prob[branches]
    leaving = np.where(targets != state, prob, 0)
    stays = leaving.sum() == 0 or (prob.max() > leaving.max() and 0 < waited < round(1 / leaving.sum()))
    return state if stays else int(targets[leaving.argmax()])


def _has_goal(program: Program) -> bool:
    return program.labels.get(GOAL_LABEL, Constant(False)) != Constant(False)


def _place(program: Program, valuation: list[int]) -> str:
    """Return the name of a location; a cell of a grid is called by row and column."""
    values = dict(zip((one.name for one in program.variables), valuation, strict=True))
    named = [one.text(values[one.name]) for one in program.variables if one.name in program.location]
    return "r{}c{}".format(*named) if len(named) == 2 else "".join(named)


def _changes(program: Program, valuations: list[list[int]]) -> Iterator[str]:
    """Yield what the variables beside the location are at first, then what each step changes of them."""
    told = told_variables(program)
    shown = [(column, one) for column, one in enumerate(program.variables) if one in told]
    before: list[int] | None = None
    for after in valuations:
        yield ", ".join(
            f"{one.name}={one.text(after[column])}"
            for column, one in shown
            if before is None or before[column] != after[column]
        )
        before = after
