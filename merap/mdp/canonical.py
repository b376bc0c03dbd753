"""Map models onto the canonical index of their case: one numbering of states and actions for all."""

from __future__ import annotations

from typing import Any

import numpy as np

from merap.errors import ModelError
from merap.mdp.alignment import align_actions, align_variables
from merap.mdp.csr import pointers_of
from merap.mdp.matching import first_repeat, match_rows
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION, FLAG_VARIABLE

ABSORBING_VALUE = -1


def canonicalise(
    mdp: TabularMDP,
    valuations: Ints,
    variable_names: tuple[str, ...],
    action_names: tuple[str, ...],
    complete_label: str | None = COMPLETE_LABEL,
) -> TabularMDP:
    """Map a model onto the canonical index of its case.

    The states are the given valuations in their order and, last, one absorbing state (all
    variables -1) into which the complete states fold. The actions are the declared ones
    and, last, `end`, the absorbing state's only choice (reward 0). Choices are ordered by
    action and branches by target, so equal models become equal arrays.

    Args:
        mdp: a whole model, as Storm builds it; unreachable states are ignored.
        valuations: int64 [P, V], all valuations that a state that isn't complete can have.
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
    _check_complete_states(mdp, complete)
    kept = mdp.reachable & ~complete
    row = np.full(mdp.num_states, len(valuations))
    row[kept] = _canonical_rows(mdp, kept, valuations, variable_names)
    action = _canonical_actions(mdp, kept, action_names)
    choices = np.flatnonzero(kept[mdp.choice_state])
    choices = choices[np.lexsort((action[choices], row[mdp.choice_state[choices]]))]
    return TabularMDP(
        **_transitions(mdp, choices, row, len(valuations)),
        choice_action=np.append(action[choices], len(action_names)),
        choice_reward=np.append(mdp.choice_reward[choices], 0.0),
        initial=np.bincount(row, mdp.initial, minlength=len(valuations) + 1).astype(np.float64),
        reachable=_marked(row[mdp.reachable], len(valuations) + 1),
        labels=_canonical_labels(mdp, kept, row, complete_label, len(valuations)),
        valuations=np.vstack((valuations, np.full((1, len(variable_names)), ABSORBING_VALUE))),
        variable_names=variable_names,
        action_names=(*action_names, END_ACTION),
    )


def _complete_states(mdp: TabularMDP, label: str | None) -> Bools:
    if label is None:
        return np.zeros(mdp.num_states, dtype=np.bool_)
    if label not in mdp.labels:
        raise ModelError(f"the model has no label {label!r}, only {', '.join(mdp.labels) or 'none'}")
    return mdp.labels[label]


def _check_complete_states(mdp: TabularMDP, complete: Bools) -> None:
    """Refuse a complete state with more than `end`, a self-loop of reward 0, and `end` elsewhere."""
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


def _canonical_rows(mdp: TabularMDP, kept: Bools, valuations: Ints, variable_names: tuple[str, ...]) -> Ints:
    """Return int64 [number of kept states], the place of each among the canonical valuations."""
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
    """Return int64 [C], the declared number of each choice's action; checked where states are kept."""
    if END_ACTION in action_names:
        raise ModelError(f"action {END_ACTION!r} is reserved, it must not be declared")
    action = align_actions(mdp, action_names)[mdp.choice_action]
    unknown = np.flatnonzero(kept[mdp.choice_state] & (action < 0))
    if len(unknown):
        choice = mdp.describe_choice(int(unknown[0]))
        raise ModelError(f"{choice}: the case declares only {', '.join(action_names)}")
    return action


def _transitions(mdp: TabularMDP, choices: Ints, row: Ints, absorbing: int) -> dict[str, Any]:
    """Build pointers and branches over the canonical rows, `end` last.

    Args:
        mdp: the model.
        choices: int64, the choices that are kept, by canonical row and action.
        row: int64 [S], the canonical row of each state.
        absorbing: the absorbing state's row, the last one.
    """
    place = np.full(mdp.num_choices, -1)
    place[choices] = np.arange(len(choices))
    branches = np.flatnonzero(place[mdp.branch_choice] >= 0)
    key = place[mdp.branch_choice[branches]] * (absorbing + 1) + row[mdp.branch_target[branches]]
    order = np.argsort(key, kind="stable")
    branches, key = branches[order], key[order]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    prob = _sums(mdp.branch_prob[branches], first)
    per_row = np.bincount(row[mdp.choice_state[choices]], minlength=absorbing + 1)
    per_row[absorbing] = 1
    per_choice = np.bincount(key[first] // (absorbing + 1), minlength=len(choices))
    arrays = {
        "state_to_choice": pointers_of(per_row),
        "choice_to_branch": pointers_of(np.append(per_choice, 1)),
        "branch_target": np.append(key[first] % (absorbing + 1), absorbing),
        "branch_prob": np.append(prob, 1.0),
    }
    if mdp.branch_reward is not None:
        earned = _sums(mdp.branch_prob[branches] * mdp.branch_reward[branches], first)
        alone = np.diff(first, append=len(key)) == 1
        mean = np.where(alone, mdp.branch_reward[branches[first]], earned / prob)
        arrays["branch_reward"] = np.append(mean, 0.0)
    return arrays


def _sums(values: Floats, first: Ints) -> Floats:
    """Sum the runs of `values` that begin at `first`."""
    sums: Floats = np.add.reduceat(values, first) if len(first) else np.zeros(0)
    return sums


def _canonical_labels(
    mdp: TabularMDP, kept: Bools, row: Ints, complete_label: str | None, absorbing: int
) -> dict[str, Bools]:
    labels = {
        name: _marked(row[kept & mask], absorbing + 1)
        for name, mask in mdp.labels.items()
        if name != complete_label
    }
    return {**labels, COMPLETE_LABEL: _marked(np.array([absorbing]), absorbing + 1)}


def _marked(rows: Ints, size: int) -> Bools:
    mask = np.zeros(size, dtype=np.bool_)
    mask[rows] = True
    return mask
