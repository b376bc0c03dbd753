"""Find maximal end components, the parts of an MDP that a policy need never leave."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from merap.mdp.model import Bools, Ints, TabularMDP


def maximal_end_components(mdp: TabularMDP, within: Bools) -> tuple[Ints, Bools]:
    """Find the maximal end components among some states (de Alfaro 1997, section 3.3).

    Choices that leave their strongly connected component are dropped until none does.

    Args:
        mdp: the model.
        within: bool [S], the states to look at.

    Returns:
        int64 [S], the number of the component of a state, -1 outside of all; bool [C], the
        choices that stay inside a component.
    """
    inner = within[mdp.choice_state] & ~_leads(mdp, ~within[mdp.branch_target])
    while True:
        component = _strong_components(mdp, inner)
        source_component = component[mdp.choice_state[mdp.branch_choice]]
        kept = inner & ~_leads(mdp, component[mdp.branch_target] != source_component)
        if np.array_equal(kept, inner):
            break
        inner = kept
    has_inner = np.bincount(mdp.choice_state[inner], minlength=mdp.num_states) > 0
    number = np.full(mdp.num_states, -1, dtype=np.int64)
    number[has_inner] = np.unique(component[has_inner], return_inverse=True)[1]
    return number, inner


def _leads(mdp: TabularMDP, branches: Bools) -> Bools:
    """Return bool [C], the choices that have one of the branches (bool [B])."""
    return np.bincount(mdp.branch_choice[branches], minlength=mdp.num_choices) > 0


def _strong_components(mdp: TabularMDP, choices: Bools) -> Ints:
    edge = choices[mdp.branch_choice]
    source = mdp.choice_state[mdp.branch_choice[edge]]
    ones = np.ones(len(source), dtype=np.float64)
    graph = csr_array((ones, (source, mdp.branch_target[edge])), shape=(mdp.num_states, mdp.num_states))
    component: Ints = connected_components(graph, directed=True, connection="strong")[1].astype(np.int64)
    return component
