"""What a model says of a state, given by its valuation, and an action, given by its name."""

from __future__ import annotations

import numpy as np

from merap.mdp.model import TabularMDP


def enabled_in(mdp: TabularMDP, *valuation: int) -> set[str]:
    (state,) = np.flatnonzero((mdp.valuations == valuation).all(axis=1)).tolist()
    return {name for name, on in zip(mdp.action_names, mdp.enabled[state], strict=True) if on}


def step(mdp: TabularMDP, valuation: tuple[int, ...], action: str) -> dict[tuple[int, ...], float]:
    """Successor valuation -> probability."""
    choice = choice_of(mdp, valuation, action)
    branches = slice(mdp.choice_to_branch[choice], mdp.choice_to_branch[choice + 1])
    return {
        tuple(mdp.valuations[target].tolist()): prob
        for target, prob in zip(mdp.branch_target[branches], mdp.branch_prob[branches].tolist(), strict=True)
    }


def choice_of(mdp: TabularMDP, valuation: tuple[int, ...], action: str) -> int:
    in_state = (mdp.valuations == valuation).all(axis=1)[mdp.choice_state]
    (choice,) = np.flatnonzero(in_state & (mdp.choice_action == mdp.action_names.index(action))).tolist()
    return int(choice)


def reward(mdp: TabularMDP, valuation: tuple[int, ...], action: str) -> float:
    return float(mdp.choice_reward[choice_of(mdp, valuation, action)])
