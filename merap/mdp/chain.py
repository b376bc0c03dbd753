"""Build the Markov chain that an MDP becomes under a policy."""

from __future__ import annotations

from os import PathLike

import numpy as np
from scipy.sparse import csr_array

from merap.mdp.csr import pointers_of
from merap.mdp.evaluation import choice_weights
from merap.mdp.graph import reachable_states, restrict_to_reachable
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.umb import write_umb
from merap.mdp.umb_encoding import CHAIN_ACTION


def induced_chain(mdp: TabularMDP, policy: Floats) -> TabularMDP:
    """Return the induced Markov chain, as an MDP with one choice per state.

    Its transition matrix is `transitions` ([S, S] in effect, D @ P with D the policy's
    weights of the choices), its expected rewards are `choice_reward`.

    Args:
        mdp: the model.
        policy: float [S, A], as for `merap.mdp.evaluation.choice_weights`.

    Returns:
        A model with the states, labels and valuations of the MDP. Rows of states that the MDP
        can't reach are empty; `reachable` marks the states that the policy reaches.

    Raises:
        ModelError: the policy isn't a distribution over the enabled actions.
    """
    weights = np.where(mdp.reachable[mdp.choice_state], choice_weights(mdp, policy), 0.0)
    decision = csr_array(
        (weights, np.arange(mdp.num_choices), mdp.state_to_choice), shape=(mdp.num_states, mdp.num_choices)
    )
    product = csr_array(decision @ mdp.transitions)
    product.eliminate_zeros()
    product.sort_indices()
    state_to_choice = pointers_of(mdp.reachable.astype(np.int64))
    choice_to_branch = np.append(product.indptr[:-1][mdp.reachable], product.nnz).astype(np.int64)
    target = product.indices.astype(np.int64)
    return TabularMDP(
        state_to_choice=state_to_choice,
        choice_to_branch=choice_to_branch,
        branch_target=target,
        branch_prob=product.data,
        choice_action=np.zeros(int(mdp.reachable.sum()), dtype=np.int64),
        choice_reward=(decision @ mdp.choice_reward)[mdp.reachable],
        initial=mdp.initial,
        reachable=reachable_states(state_to_choice, choice_to_branch, target, mdp.initial > 0),
        labels=mdp.labels,
        valuations=mdp.valuations,
        variable_names=mdp.variable_names,
        action_names=(CHAIN_ACTION,),
    )


def write_induced_chain(
    mdp: TabularMDP,
    policy: Floats,
    path: str | PathLike[str],
    *,
    reward: str = "objective",
    overwrite: bool = False,
) -> None:
    """Write the induced chain, restricted to states that the policy reaches, as a UMB Markov chain.

    Args:
        mdp: the model.
        policy: float [S, A].
        path: the file to write.
        reward: the name of the rewards in it.
        overwrite: replace a file that is there.

    Raises:
        ModelError: the policy isn't a distribution over the enabled actions.
        OutputError: the file is there already or can't be written.
    """
    chain = restrict_to_reachable(induced_chain(mdp, policy))
    write_umb(chain, path, reward=reward, as_chain=True, overwrite=overwrite)
