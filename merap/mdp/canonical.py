"""The canonical index of a case: one numbering of states and actions for all its models."""

from __future__ import annotations

import numpy as np

from merap.errors import ModelError
from merap.mdp.matching import first_repeat, match_rows
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.segments import pointers_of

END_ACTION = "end"
COMPLETE_LABEL = "done"
# The variable that tells complete states apart; the canonical index has one state for all.
FLAG_VARIABLE = "done"
ABSORBING_VALUE = -1


def canonicalise(
    mdp: TabularMDP,
    valuations: Ints,
    variable_names: tuple[str, ...],
    action_names: tuple[str, ...],
    complete_label: str | None = COMPLETE_LABEL,
) -> TabularMDP:
    """Maps a model onto the canonical index of its case (design, section 6).

    The states are the given valuations in their order and, last, one absorbing state (all
    variables -1) into which the complete states fold. The actions are the declared ones
    and, last, `end`, the absorbing state's only choice (reward 0). Choices are ordered by
    action and branches by target, so equal models become equal arrays.

    Args:
        mdp: a whole model, as Storm builds it; unreachable states are ignored.
        valuations: int64 [P, V], all values a state that isn't complete can have.
        variable_names: V names; the model has these and possibly `done`.
        action_names: the declared actions, without `end`.
        complete_label: marks the complete states; None for a model that has none.

    Returns:
        A model of P + 1 states. Rows of unreachable and of complete valuations are empty
        and marked unreachable. `done` labels the absorbing state alone, other labels hold
        where they hold for states that aren't complete. Branches of one choice into
        complete states become one, with the mean reward.

    Raises:
        ModelError: variables or actions differ from the declared ones, a valuation isn't
            among the canonical ones, or a complete state does anything but `end`.
    """
    complete = _complete_states(mdp, complete_label)
    kept = mdp.reachable & ~complete
    _check_complete_states(mdp, complete)
    num_rows = len(valuations) + 1
    row = np.full(mdp.num_states, num_rows - 1)
    row[kept] = _canonical_rows(mdp, kept, valuations, variable_names)
    action = _canonical_actions(mdp, kept, action_names)
    return _assemble(mdp, kept, row, action, valuations, variable_names, action_names)


def align_actions(mdp: TabularMDP, action_names: tuple[str, ...]) -> Ints:
    """Where each action of a model stands among other names.

    Args:
        mdp: the model.
        action_names: the names to find its actions in.

    Returns:
        int64 [A], an index into `action_names`; -1 for one that isn't there.
    """
    index = {name: position for position, name in enumerate(action_names)}
    return np.array([index.get(name, -1) for name in mdp.action_names], dtype=np.int64)


def align_variables(mdp: TabularMDP, variable_names: tuple[str, ...]) -> Ints:
    """The valuations of a model with its columns in another order.

    Args:
        mdp: the model.
        variable_names: the order that is wanted.

    Returns:
        int64 [S, len(variable_names)].

    Raises:
        ModelError: a variable exists only in one of both; names it.
    """
    for name in mdp.variable_names:
        if name not in variable_names:
            raise ModelError(f"variable {name!r} of the model is not one of {', '.join(variable_names)}")
    for name in variable_names:
        if name not in mdp.variable_names:
            raise ModelError(f"the model has no variable {name!r}, only {', '.join(mdp.variable_names)}")
    return mdp.valuations[:, [mdp.variable_names.index(name) for name in variable_names]]


def _complete_states(mdp: TabularMDP, label: str | None) -> Bools:
    if label is None:
        return np.zeros(mdp.num_states, dtype=np.bool_)
    if label not in mdp.labels:
        raise ModelError(f"the model has no label {label!r}, only {', '.join(mdp.labels) or 'none'}")
    return mdp.labels[label]


def _check_complete_states(mdp: TabularMDP, complete: Bools) -> None:
    """A complete state has `end` alone, a self-loop of reward 0; no other state has `end`."""
    live = mdp.reachable[mdp.choice_state]
    of_complete = complete[mdp.choice_state]
    is_end = align_actions(mdp, (END_ACTION,))[mdp.choice_action] == 0
    wrong = np.flatnonzero(live & (of_complete != is_end))
    if len(wrong):
        kind = "complete" if of_complete[wrong[0]] else "not complete"
        raise ModelError(f"{mdp.describe_choice(int(wrong[0]))}: not allowed in a state that is {kind}")
    leaving = np.flatnonzero(
        (live & is_end)[mdp.branch_choice] & (mdp.branch_target != mdp.choice_state[mdp.branch_choice])
    )
    if len(leaving):
        choice = int(mdp.branch_choice[leaving[0]])
        raise ModelError(f"{mdp.describe_choice(choice)}: leaves the state, it must be a self-loop")
    paid = np.flatnonzero(live & is_end & (mdp.choice_reward != 0))
    if len(paid):
        reward = mdp.choice_reward[paid[0]]
        raise ModelError(f"{mdp.describe_choice(int(paid[0]))}: has reward {reward}, it must be 0")


def _canonical_rows(
    mdp: TabularMDP, kept: Bools, valuations: Ints, variable_names: tuple[str, ...]
) -> Ints:
    """int64 [number of kept states], where each stands among the canonical valuations."""
    flagged = FLAG_VARIABLE in mdp.variable_names and FLAG_VARIABLE not in variable_names
    columns = align_variables(mdp, (*variable_names, FLAG_VARIABLE) if flagged else variable_names)
    states = np.flatnonzero(kept)
    rows = match_rows(columns[states, : len(variable_names)], valuations)
    unknown = np.flatnonzero(rows < 0)
    if len(unknown):
        state = mdp.describe_state(int(states[unknown[0]]))
        raise ModelError(f"state {state} is not among the {len(valuations)} states of the case")
    repeated = first_repeat(rows)
    if repeated is not None:
        one, other = (mdp.describe_state(int(states[position])) for position in repeated)
        raise ModelError(f"states {one} and {other}, neither complete, are one state of the case")
    return rows


def _canonical_actions(mdp: TabularMDP, kept: Bools, action_names: tuple[str, ...]) -> Ints:
    """int64 [C], the declared number of each choice's action; checked where states are kept."""
    if END_ACTION in action_names:
        raise ModelError(f"action {END_ACTION!r} is reserved, it must not be declared")
    action = align_actions(mdp, action_names)[mdp.choice_action]
    unknown = np.flatnonzero(kept[mdp.choice_state] & (action < 0))
    if len(unknown):
        choice = mdp.describe_choice(int(unknown[0]))
        raise ModelError(f"{choice}: the case declares only {', '.join(action_names)}")
    return action


def _assemble(
    mdp: TabularMDP,
    kept: Bools,
    row: Ints,
    action: Ints,
    valuations: Ints,
    variable_names: tuple[str, ...],
    action_names: tuple[str, ...],
) -> TabularMDP:
    absorbing = len(valuations)
    num_rows = absorbing + 1
    choices = np.flatnonzero(kept[mdp.choice_state])
    choices = choices[np.lexsort((action[choices], row[mdp.choice_state[choices]]))]
    target, prob, branch_reward, lengths = _fold_branches(mdp, choices, row, num_rows)
    initial = np.bincount(row, np.where(mdp.reachable, mdp.initial, 0.0), minlength=num_rows)
    reachable = np.zeros(num_rows, dtype=np.bool_)
    reachable[row[mdp.reachable]] = True
    per_row = np.bincount(row[mdp.choice_state[choices]], minlength=num_rows)
    per_row[absorbing] = 1
    return TabularMDP(
        state_to_choice=pointers_of(per_row),
        choice_to_branch=pointers_of(np.append(lengths, 1)),
        branch_target=np.append(target, absorbing),
        branch_prob=np.append(prob, 1.0),
        choice_action=np.append(action[choices], len(action_names)),
        choice_reward=np.append(mdp.choice_reward[choices], 0.0),
        initial=initial,
        reachable=reachable,
        labels=_canonical_labels(mdp, kept, row, num_rows),
        valuations=np.vstack((valuations, np.full((1, len(variable_names)), ABSORBING_VALUE))),
        variable_names=variable_names,
        action_names=(*action_names, END_ACTION),
        branch_reward=None if branch_reward is None else np.append(branch_reward, 0.0),
    )
