"""Import Gymnasium environments that have a table `P` as models with one completed state.

Axes: S states of the table, B branches.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.errors import InputError
from merap.mdp.assembly import Branches, assemble
from merap.mdp.graph import reachable_along
from merap.mdp.gymnasium_spaces import changing_wrapper, gymnasium
from merap.mdp.gymnasium_toy_text import TableNames, names_of, numbered_names
from merap.mdp.index import values_below
from merap.mdp.model import ROW_SUM_TOLERANCE, Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION

# state -> action -> [(probability, next state, reward, terminated)]; lists may stand for the mappings.
Table = Mapping[int, Any] | Sequence[Any]


def import_gymnasium(env: str | gymnasium.Env[Any, Any], **kwargs: Any) -> TabularMDP:
    """Import a Gymnasium environment that has a transition table `P`.

    Transitions and rewards are those of `env.unwrapped`: wrappers that change rewards or limit
    the steps are no part of the model. A wrapper that may change observations or actions is
    refused, since `P` counts those of `env.unwrapped`. FrozenLake, CliffWalking and Taxi come
    with their factors, action names and labels; others with the variable `state`, counted as
    the observation space counts, and actions `a0`, `a1`, ... See `import_table` for the form.

    Args:
        env: an environment, or the id of one.
        kwargs: arguments of `gymnasium.make`, if it is an id.

    Raises:
        InputError: there is no such environment; it has no `P` or no `initial_state_distrib`, has
            dynamics that `P` leaves out or spaces of other sizes, or a wrapper may change them.
        ModelError: the table is no MDP; names state and action.
    """
    if isinstance(env, str):
        made = make_environment(env, kwargs)
        try:
            return _import_environment(made)
        finally:
            made.close()
    if kwargs:
        raise InputError(f"{', '.join(kwargs)}: arguments are for an id, not for a ready environment")
    if not isinstance(env, gymnasium.Env):
        raise InputError(f"only an environment or its id can be imported, not {type(env).__name__}")
    return _import_environment(env)


def import_table(table: Table, initial: npt.ArrayLike, names: TableNames | None = None) -> TabularMDP:
    """Import a transition table as a model with one completed state.

    After the states of the table stands one absorbing state, `done`, with the action `end`;
    branches flagged as terminated lead there (only these: an unflagged one into the same
    state goes on). Branches with equal successor become one, with the mean reward. Rows of
    states that are not reachable then, such as those in which an episode has ended, are
    empty. Labels describe the table's states, and so may hold where no episode gets to.

    Args:
        table: `table[s][a]`, a list of (probability, next state, reward, terminated).
        initial: float64 [S], a distribution.
        names: of states and actions; by default numbers.

    Raises:
        InputError: the table isn't of that form; names the entry.
        ModelError: the table is no MDP; names state and action.
    """
    num_states = len(table)
    rows = _rows(table)
    num_actions = int(rows.action.max()) + 1
    names = numbered_names(num_states, num_actions) if names is None else names
    if num_actions > len(names.action_names):
        raise InputError(f"P has action {num_actions - 1}, there are {len(names.action_names)} action names")
    start = np.asarray(initial, dtype=np.float64)
    if start.shape != (num_states,):
        raise InputError(f"the initial distribution has shape {start.shape}, P has {num_states} states")
    return assemble(
        _branches(rows, start, len(names.action_names)),
        initial=np.append(start, 0.0),
        labels={
            **{name: np.append(mask, False) for name, mask in names.labels.items()},
            COMPLETE_LABEL: np.arange(num_states + 1) == num_states,
        },
        valuations=np.vstack([names.valuations, values_below(names.valuations, 1)]),
        variable_names=names.variable_names,
        action_names=(*names.action_names, END_ACTION),
    )


def make_environment(env_id: str, kwargs: Mapping[str, Any]) -> gymnasium.Env[Any, Any]:
    """Make the environment with an id.

    Raises:
        InputError: Gymnasium can't make it.
    """
    try:
        return gymnasium.make(env_id, **kwargs)
    except (gymnasium.error.Error, ModuleNotFoundError, TypeError) as error:
        raise InputError(f"Gymnasium can't make {env_id!r}: {error}") from error


def _import_environment(env: gymnasium.Env[Any, Any]) -> TabularMDP:
    base = env.unwrapped
    table, initial = _attribute(base, "P"), _attribute(base, "initial_state_distrib")
    wrapper = changing_wrapper(env)
    if wrapper is not None:
        raise InputError(
            f"{_title(base)}: {wrapper} may change observations or actions, and P is about those of the "
            "environment inside; to import that one, pass env.unwrapped"
        )
    return import_table(table, initial, names_of(base) or _numbered_by_spaces(base, len(table)))


def _numbered_by_spaces(env: gymnasium.Env[Any, Any], num_states: int) -> TableNames | None:
    """Number states and actions as discrete spaces do; None if there are none."""
    spaces = getattr(env, "observation_space", None), getattr(env, "action_space", None)
    states, actions = spaces
    if not (isinstance(states, gymnasium.spaces.Discrete) and isinstance(actions, gymnasium.spaces.Discrete)):
        return None
    if states.n != num_states:
        raise InputError(f"{_title(env)}: P has {num_states} states, the observation space is {states}")
    return numbered_names(num_states, int(actions.n), int(states.start))


def _title(env: gymnasium.Env[Any, Any]) -> str:
    return env.spec.id if env.spec is not None else type(env).__name__


def _attribute(env: gymnasium.Env[Any, Any], name: str) -> Any:
    if not hasattr(env, name):
        raise InputError(
            f"{_title(env)} has no {name}: an environment needs P and initial_state_distrib to be imported, "
            "as FrozenLake, Taxi and CliffWalking have them"
        )
    return getattr(env, name)


@dataclass(frozen=True, eq=False)
class _Rows:
    """The entries of a table, arrays [B]."""

    state: Ints
    action: Ints
    prob: Floats
    next_state: Ints
    reward: Floats
    terminated: Bools


_ENTRY = "(probability, next state, reward, terminated)"


def _rows(table: Table) -> _Rows:
    columns = _columns(table)
    _check_columns(columns, len(table))
    state, action, prob, next_state, reward, terminated = columns
    return _Rows(
        state.astype(np.int64),
        action.astype(np.int64),
        prob,
        next_state.astype(np.int64),
        reward,
        terminated != 0,
    )


def _columns(table: Table) -> Floats:
    """Return float64 [6, B]: state, action, probability, next state, reward, terminated."""
    try:
        entries = _entries(table)
        odd = next((entry for entry in entries if len(entry) != 6), None)
        if odd is not None:
            raise InputError(f"P[{odd[0]}][{odd[1]}] holds {odd[2:]}, not {_ENTRY}")
        columns = np.array(entries, dtype=np.float64).T
    except (TypeError, ValueError) as error:
        raise InputError(f"P must be state -> action -> list of {_ENTRY}, all numbers: {error}") from error
    if not columns.size:
        raise InputError("P is empty")
    return columns


def _entries(table: Table) -> list[tuple[Any, ...]]:
    # The source is nested Python objects: they are gone through here, once.
    return [
        (state, action, *branch)
        for state, actions in _items(table)
        for action, branches in _items(actions)
        for branch in branches
    ]


def _items(table: Any) -> Iterable[tuple[Any, Any]]:
    items: Iterable[tuple[Any, Any]] = table.items() if isinstance(table, Mapping) else enumerate(table)
    return items


def _check_columns(columns: Floats, num_states: int) -> None:
    state, action, prob, next_state, _, _ = columns
    last = f"an integer from 0 to {num_states - 1}"
    _refuse(columns, ~_is_index(state, num_states), state, f"a state is {last}")
    _refuse(columns, ~_is_index(action, np.inf), action, "an action is an integer from 0 on")
    _refuse(columns, ~_is_index(next_state, num_states), next_state, f"a next state is {last}")
    _refuse(columns, ~((prob >= 0) & (prob <= 1 + ROW_SUM_TOLERANCE)), prob, "a probability is in [0, 1]")


def _is_index(numbers: Floats, size: float) -> Bools:
    mask: Bools = (numbers >= 0) & (numbers < size) & (numbers == np.floor(numbers))
    return mask


def _refuse(columns: Floats, wrong: Bools, values: Floats, allowed: str) -> None:
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        state, action = columns[:2, first]
        raise InputError(f"P[{state:g}][{action:g}] has {values[first]:g}: {allowed}")


def _branches(rows: _Rows, initial: Floats, num_actions: int) -> Branches:
    """Return the branches of reachable states, and `end` (action `num_actions`) of the absorbing state."""
    absorbing = len(initial)
    target = np.where(rows.terminated, absorbing, rows.next_state)
    possible = rows.prob > 0
    reachable = reachable_along(rows.state[possible], target[possible], np.append(initial, 0.0) > 0)
    kept = possible & reachable[rows.state]
    return Branches(
        state=np.append(rows.state[kept], absorbing),
        action=np.append(rows.action[kept], num_actions),
        target=np.append(target[kept], absorbing),
        prob=np.append(rows.prob[kept], 1.0),
        reward=np.append(rows.reward[kept], 0.0),
    )
