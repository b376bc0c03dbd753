"""Turn an exploration into an MDP: names of actions, labels, rewards.

Axes: N states, B branches.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from merap.errors import ModelError
from merap.mdp.assembly import Branches, assemble
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.program.exploration import Exploration, joined
from merap.program.expressions import Expression, Scope, evaluate_where_defined
from merap.program.form import Program
from merap.program.states import States, StepColumns
from merap.program.steps import CommandChoice, StepBranches


def ambiguous_actions(exploration: Exploration) -> frozenset[str]:
    """Return the actions for which some state has more than one choice of commands."""
    several: dict[str, list[int]] = {}
    for number, choice in enumerate(exploration.choices):
        if choice.labelled:
            several.setdefault(choice.action, []).append(number)
    return frozenset(
        action for action, numbers in several.items() if len(numbers) > 1 and _meet(exploration, numbers)
    )


def _meet(exploration: Exploration, numbers: list[int]) -> bool:
    """Return whether a state has two of some choices."""
    branches = exploration.branches
    place = np.full(len(exploration.choices), -1)
    place[numbers] = np.arange(len(numbers))
    rows = np.flatnonzero(place[branches.choice] >= 0)
    source, choice = exploration.place(branches.source[rows]), place[branches.choice[rows]]
    one = np.full(len(exploration.codes), -1)
    one[source] = choice
    return bool(np.any(one[source] != choice))


def tabular(
    program: Program,
    exploration: Exploration,
    *,
    reward: str | None = None,
    ambiguous: Collection[str] | None = None,
    deadlock: str | None = None,
) -> TabularMDP:
    """Return the MDP of a program.

    The name of an action is kept, except for one that is ambiguous: it becomes `action#i.j`, by the
    positions of the commands; a command without an action is `process#i`.

    Args:
        program: that was explored.
        exploration: of it.
        reward: the reward structure to take; None: no rewards.
        ambiguous: actions with more than one choice of commands in a state of some member of the
            family; None: in a state of this one.
        deadlock: the action of a self-loop in states without a choice; None: such a state is refused.

    Raises:
        ModelError: a state has no choice; a label or reward is undefined; there is no such structure.
    """
    if reward is not None and reward not in program.rewards:
        known = ", ".join(sorted(program.rewards)) or "none"
        raise ModelError(f"{program.name}: there is no reward structure {reward!r}; there are: {known}")
    doubled = ambiguous_actions(exploration) if ambiguous is None else ambiguous
    whole = _without_deadlocks(program, exploration, deadlock)
    names = [_name(choice, doubled) for choice in whole.choices]
    action_names = tuple(dict.fromkeys(names))
    place = {name: number for number, name in enumerate(action_names)}
    branches, codes = whole.branches, whole.codes
    return assemble(
        Branches(
            state=whole.place(branches.source),
            action=np.array([place[name] for name in names], dtype=np.int64)[branches.choice],
            target=whole.place(branches.target),
            prob=branches.prob,
            reward=np.zeros(len(branches.prob)) if reward is None else _rewards(program, reward, whole),
        ),
        initial=whole.initial,
        labels=_labels(program, whole),
        valuations=whole.encoding.valuations(codes),
        variable_names=tuple(variable.name for variable in program.variables),
        action_names=action_names,
        reachable=np.ones(len(codes), dtype=np.bool_),
    )


def _without_deadlocks(program: Program, exploration: Exploration, action: str | None) -> Exploration:
    """Give the states without a choice a self-loop; its steps earn the rewards of every step."""
    stepping = np.zeros(len(exploration.codes), dtype=np.bool_)
    stepping[exploration.place(exploration.branches.source)] = True
    stuck = exploration.codes[~stepping]
    if not len(stuck):
        return exploration
    if action is None:
        state = exploration.encoding.describe(int(stuck[0]))
        raise ModelError(f"{program.name}: no command is enabled in state {state}")
    number = np.full(len(stuck), len(exploration.choices))
    loops = StepBranches(stuck, number, stuck, np.ones(len(stuck)))
    return replace(
        exploration,
        branches=joined([exploration.branches, loops]),
        choices=(*exploration.choices, CommandChoice(action, True, ())),
    )


def _name(choice: CommandChoice, ambiguous: Collection[str]) -> str:
    return choice.action if choice.labelled and choice.action not in ambiguous else choice.name


def _labels(program: Program, exploration: Exploration) -> dict[str, Bools]:
    states = States(exploration.encoding, exploration.codes)
    return {
        name: _defined(program, where, states, exploration.codes, exploration, f'the label "{name}"').astype(
            np.bool_
        )
        for name, where in program.labels.items()
    }


def _rewards(program: Program, name: str, exploration: Exploration) -> Floats:
    """float64 [B], what each branch earns."""
    structure = program.rewards[name]
    branches = exploration.branches
    names = [choice.action if choice.labelled else None for choice in exploration.choices]
    earned, open_ = np.zeros(len(branches.prob)), np.ones(len(branches.prob), dtype=np.bool_)
    for rule in structure.rules:
        known = np.array([not rule.actions or name in rule.actions for name in names], dtype=np.bool_)
        rows = np.flatnonzero(open_ & known[branches.choice])
        scope, source = _steps(exploration, rows), branches.source[rows]
        holds = _defined(program, rule.guard, scope, source, exploration, "the guard of a reward")
        rows = rows[holds.astype(np.bool_)]
        scope, source = _steps(exploration, rows), branches.source[rows]
        earned[rows] += _defined(program, rule.value, scope, source, exploration, "a reward")
        if structure.first_match:
            open_[rows] = False
    return earned


def _steps(exploration: Exploration, rows: Ints) -> StepColumns:
    branches, encoding = exploration.branches, exploration.encoding
    after = States(encoding, branches.target[rows])
    return StepColumns(States(encoding, branches.source[rows]), after)


def _defined(
    program: Program, expression: Expression, scope: Scope, codes: Ints, exploration: Exploration, what: str
) -> npt.NDArray[np.float64] | Bools:
    values, defined = (
        np.broadcast_to(part, codes.shape) for part in evaluate_where_defined(expression, scope)
    )
    if not defined.all():
        state = exploration.encoding.describe(int(codes[~defined][0]))
        raise ModelError(f"{program.name}: {what} is undefined in state {state}")
    return values
