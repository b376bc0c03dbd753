"""Complete states of a model: those in which nothing changes any more."""

from __future__ import annotations

import numpy as np

from merap.errors import ModelError
from merap.mdp.alignment import align_actions
from merap.mdp.model import Bools, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION


def complete_states(model: TabularMDP) -> Bools:
    """Return bool [S], the states labelled `done`; none if there is no such label."""
    if COMPLETE_LABEL not in model.labels:
        return np.zeros(model.num_states, dtype=np.bool_)
    return model.labels[COMPLETE_LABEL]


def label_sets(model: TabularMDP, states: Ints) -> tuple[list[frozenset[str]], Ints]:
    """Return the distinct sets of labels that some states have beside `done`, and which each of them has.

    Args:
        model: the model.
        states: int64 [K].

    Returns:
        The sets, and int64 [K], for each state the number of its set.
    """
    names = sorted(model.labels.keys() - {COMPLETE_LABEL})
    table = np.array([model.labels[name][states] for name in names]).reshape(len(names), len(states))
    distinct, which = np.unique(table.T, axis=0, return_inverse=True)
    sets = [frozenset(name for name, has in zip(names, row, strict=True) if has) for row in distinct.tolist()]
    return sets, which.reshape(-1)


def require_closed(model: TabularMDP, complete: Bools) -> None:
    """Refuse a complete state with more than `end`, a self-loop of reward 0, and `end` elsewhere.

    Args:
        model: the model; states that it does not reach are not looked at.
        complete: bool [S], its complete states.

    Raises:
        ModelError: names the state and the action.
    """
    live = model.reachable[model.choice_state]
    of_complete = complete[model.choice_state]
    is_end = align_actions(model, (END_ACTION,))[model.choice_action] == 0
    wrong = np.flatnonzero(live & (of_complete != is_end))
    if len(wrong):
        kind = "complete" if of_complete[wrong[0]] else "not complete"
        raise ModelError(f"{model.describe_choice(int(wrong[0]))}: not allowed in a state that is {kind}")
    leaving = np.flatnonzero(
        (live & is_end)[model.branch_choice]
        & (model.branch_target != model.choice_state[model.branch_choice])
    )
    if len(leaving):
        choice = int(model.branch_choice[leaving[0]])
        raise ModelError(f"{model.describe_choice(choice)}: leaves the state, it must be a self-loop")
    paid = np.flatnonzero(live & is_end & (model.choice_reward != 0))
    if len(paid):
        reward = model.choice_reward[paid[0]]
        raise ModelError(f"{model.describe_choice(int(paid[0]))}: has reward {reward}, it must be 0")
