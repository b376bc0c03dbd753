"""Analyse the graph of an MDP: reachability, restriction, sets of probability 0 and 1."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra

from merap.mdp.csr import pointers_of, ragged_indices
from merap.mdp.model import Bools, Ints, TabularMDP


def reachable_states(
    state_to_choice: Ints, choice_to_branch: Ints, branch_target: Ints, sources: Bools
) -> Bools:
    """Return the states that choices lead to from the sources, sources included.

    Args:
        state_to_choice: int64 [S + 1], pointers.
        choice_to_branch: int64 [C + 1], pointers.
        branch_target: int64 [B].
        sources: bool [S].

    Returns:
        bool [S].
    """
    return _closure(choice_to_branch[state_to_choice], branch_target, sources)


def states_reaching(mdp: TabularMDP, target: Bools, choices: Bools, blocked: Bools | None = None) -> Bools:
    """Return the states from which some of the given choices can lead to the target, target included.

    Args:
        mdp: the model.
        target: bool [S].
        choices: bool [C], the choices that may be taken.
        blocked: bool [S], states that no path may leave; none by default.

    Returns:
        bool [S].
    """
    usable = choices if blocked is None else choices & ~blocked[mdp.choice_state]
    edge = usable[mdp.branch_choice]
    source = mdp.choice_state[mdp.branch_choice[edge]]
    return reachable_along(mdp.branch_target[edge], source, target)


def reachable_along(source: Ints, target: Ints, roots: Bools) -> Bools:
    """Return the nodes that edges lead to from the roots, roots included.

    Args:
        source: int64 [E], where each edge begins; in any order.
        target: int64 [E], where it ends.
        roots: bool [S].

    Returns:
        bool [S].
    """
    order = np.argsort(source, kind="stable")
    pointers = pointers_of(np.bincount(source, minlength=len(roots)))
    return _closure(pointers, target[order], roots)


def _closure(pointers: Ints, successors: Ints, sources: Bools) -> Bools:
    """Search breadth-first in the graph with rows `successors[pointers[s]:pointers[s + 1]]`."""
    size = len(sources)
    roots = np.flatnonzero(sources)
    # A further node leads to all sources, so that one search serves them all.
    indptr = np.append(pointers, len(successors) + len(roots))
    indices = np.concatenate((successors, roots))
    ones = np.ones(len(indices), dtype=np.float64)
    graph = csr_array((ones, indices, indptr), shape=(size + 1, size + 1))
    found = breadth_first_order(graph, size, directed=True, return_predecessors=False)
    mask = np.zeros(size + 1, dtype=np.bool_)
    mask[found] = True
    return mask[:size]


def fewest_steps(mdp: TabularMDP, target: Bools) -> float:
    """Return the number of steps on the shortest path from an initial state to the target.

    Args:
        mdp: the model.
        target: bool [S].

    Returns:
        0 if an initial state is in the target, infinity if no path leads there.
    """
    pointers = mdp.choice_to_branch[mdp.state_to_choice]
    shape = (mdp.num_states, mdp.num_states)
    graph = csr_array((np.ones(len(mdp.branch_target)), mdp.branch_target, pointers), shape=shape)
    steps = dijkstra(graph, indices=np.flatnonzero(mdp.initial), unweighted=True, min_only=True)
    return float(steps[target].min(initial=np.inf))


def attractor(mdp: TabularMDP, target: Bools) -> Bools:
    """Return the states from which every policy reaches the target with positive probability.

    Complement of the set Prob0E (Baier and Katoen 2008, section 10.6.1): a
    state joins when each of its choices has a branch into the set.

    Args:
        mdp: the model.
        target: bool [S].

    Returns:
        bool [S], target included.
    """
    order = np.argsort(mdp.branch_target, kind="stable")
    incoming = mdp.branch_choice[order]
    incoming_start = pointers_of(np.bincount(mdp.branch_target, minlength=mdp.num_states))
    inside = target.copy()
    hit = np.zeros(mdp.num_choices, dtype=np.bool_)
    missing = np.diff(mdp.state_to_choice)
    frontier = np.flatnonzero(target)
    while len(frontier):
        entering = np.unique(incoming[ragged_indices(incoming_start, frontier)])
        entering = entering[~hit[entering]]
        hit[entering] = True
        sources, newly_hit = np.unique(mdp.choice_state[entering], return_counts=True)
        missing[sources] -= newly_hit
        frontier = sources[(missing[sources] == 0) & ~inside[sources]]
        inside[frontier] = True
    return inside


def surely_reaching(mdp: TabularMDP, target: Bools) -> Bools:
    """Return the states from which some policy reaches the target with probability 1.

    The set Prob1E (Baier and Katoen 2008, section 10.6.1): the largest set
    whose states reach the target through choices that never leave the set.

    Args:
        mdp: the model.
        target: bool [S].

    Returns:
        bool [S], target included.
    """
    inside = np.ones(mdp.num_states, dtype=np.bool_)
    while True:
        leaves = np.bincount(mdp.branch_choice[~inside[mdp.branch_target]], minlength=mdp.num_choices) > 0
        remaining = states_reaching(mdp, target, ~leaves)
        if np.array_equal(remaining, inside):
            return inside
        inside = remaining


def restrict_to_reachable(mdp: TabularMDP) -> TabularMDP:
    """Return the model without its unreachable states, the others in their order.

    Args:
        mdp: any model, such as one on a canonical index with empty rows.

    Returns:
        A model all of whose states are reachable.
    """
    keep_choice = mdp.reachable[mdp.choice_state]
    keep_branch = keep_choice[mdp.branch_choice]
    new_state = np.cumsum(mdp.reachable) - 1
    return TabularMDP(
        state_to_choice=pointers_of(np.diff(mdp.state_to_choice)[mdp.reachable]),
        choice_to_branch=pointers_of(np.diff(mdp.choice_to_branch)[keep_choice]),
        branch_target=new_state[mdp.branch_target[keep_branch]],
        branch_prob=mdp.branch_prob[keep_branch],
        choice_action=mdp.choice_action[keep_choice],
        choice_reward=mdp.choice_reward[keep_choice],
        initial=mdp.initial[mdp.reachable],
        reachable=np.ones(int(mdp.reachable.sum()), dtype=np.bool_),
        labels={name: mask[mdp.reachable] for name, mask in mdp.labels.items()},
        valuations=mdp.valuations[mdp.reachable],
        variable_names=mdp.variable_names,
        action_names=mdp.action_names,
        branch_reward=None if mdp.branch_reward is None else mdp.branch_reward[keep_branch],
    )
