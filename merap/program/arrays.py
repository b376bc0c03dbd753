"""Turn an exploration into an MDP: actions, labels, rewards.

Axes: N states, B branches.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from merap.errors import ModelError
from merap.mdp.assembly import Branches, assemble
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.program.exploration import Exploration
from merap.program.expressions import Expression, Scope, evaluate_where_defined
from merap.program.form import Program
from merap.program.states import States, StepColumns
from merap.program.unique_actions import ambiguous_actions


def tabular(program: Program, exploration: Exploration, *, reward: str | None = None) -> TabularMDP:
    """Return the MDP of a program with unique actions.

    Args:
        program: that was explored.
        exploration: of it.
        reward: the reward structure to take; None: no rewards.

    Raises:
        ModelError: a state has no choice, or two choices of one action; a label or reward is undefined;
            there is no such structure.
    """
    if reward is not None and reward not in program.rewards:
        known = ", ".join(sorted(program.rewards)) or "none"
        raise ModelError(f"{program.name}: there is no reward structure {reward!r}; there are: {known}")
    _require_unique(program, exploration)
    place = {name: number for number, name in enumerate(program.actions)}
    chosen = np.array([place[choice.action] for choice in exploration.choices], dtype=np.int64)
    branches, codes = exploration.branches, exploration.codes
    return assemble(
        Branches(
            state=exploration.place(branches.source),
            action=chosen[branches.choice],
            target=exploration.place(branches.target),
            prob=branches.prob,
            reward=np.zeros(len(branches.prob)) if reward is None else _rewards(program, reward, exploration),
        ),
        initial=exploration.initial,
        labels=_labels(program, exploration),
        valuations=exploration.encoding.valuations(codes),
        variable_names=tuple(variable.name for variable in program.variables),
        action_names=program.actions,
        reachable=np.ones(len(codes), dtype=np.bool_),
    )


def _require_unique(program: Program, exploration: Exploration) -> None:
    stuck = stuck_state(exploration)
    if stuck is not None:
        raise ModelError(f"{program.name}: state {stuck} can be reached and has no action")
    for action, code in ambiguous_actions(exploration).items():
        state = exploration.encoding.describe(code)
        raise ModelError(f"{program.name}: two commands of {action} are enabled in state {state}")


def stuck_state(exploration: Exploration) -> str | None:
    """Describe a state without a choice; None if there is none."""
    stepping = np.zeros(len(exploration.codes), dtype=np.bool_)
    stepping[exploration.place(exploration.branches.source)] = True
    if stepping.all():
        return None
    return exploration.encoding.describe(int(exploration.codes[~stepping][0]))


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
    names = [choice.action for choice in exploration.choices]
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
