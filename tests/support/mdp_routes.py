"""Second routes to what an MDP is: dense arrays, plain dictionaries, another order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

import numpy as np

from merap.mdp.model import Floats, TabularMDP
from tests.support.mdp_examples import State, make_mdp


def random_policy(generator: np.random.Generator, mdp: TabularMDP) -> Floats:
    """Return float64 [S, A], a distribution over the enabled actions of each state."""
    weights = np.where(mdp.enabled, generator.random(mdp.enabled.shape), 0.0)
    policy: Floats = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
    return policy


def as_choices(mdp: TabularMDP) -> dict[State, dict[str, tuple[float, Mapping[State, float]]]]:
    """Return the model as it is written for `make_mdp`, by a plain loop."""
    states = [tuple(row) for row in mdp.valuations.tolist()]
    choices: dict[State, dict[str, tuple[float, Mapping[State, float]]]] = {state: {} for state in states}
    for choice in range(mdp.num_choices):
        branches = range(mdp.choice_to_branch[choice], mdp.choice_to_branch[choice + 1])
        successors = {
            states[mdp.branch_target[branch]]: float(mdp.branch_prob[branch]) for branch in branches
        }
        name = mdp.action_names[mdp.choice_action[choice]]
        choices[states[mdp.choice_state[choice]]][name] = (float(mdp.choice_reward[choice]), successors)
    return choices


def shuffled(generator: np.random.Generator, mdp: TabularMDP) -> TabularMDP:
    """Return the same model with states, variables, choices, branches and actions in another order."""
    columns = generator.permutation(len(mdp.variable_names)).tolist()

    def moved(state: State) -> State:
        return tuple(state[column] for column in columns)

    choices = as_choices(mdp)
    states = [list(choices)[index] for index in generator.permutation(len(choices))]
    mixed: dict[State, dict[str, tuple[float, Mapping[State, float]]]] = {}
    for state in states:
        row = list(choices[state].items())
        mixed[moved(state)] = {}
        for index in generator.permutation(len(row)):
            name, (reward, branches) = row[index]
            order = generator.permutation(len(branches)).tolist()
            listed = [list(branches.items())[place] for place in order]
            mixed[moved(state)][name] = (reward, {moved(target): prob for target, prob in listed})
    valuations = [tuple(row) for row in mdp.valuations.tolist()]
    return make_mdp(
        mixed,
        variables=tuple(mdp.variable_names[column] for column in columns),
        actions=tuple(mdp.action_names[index] for index in generator.permutation(mdp.num_actions)),
        initial={
            moved(state): float(prob) for state, prob in zip(valuations, mdp.initial, strict=True) if prob
        },
        labels={
            name: {moved(state) for state, holds in zip(valuations, mask, strict=True) if holds}
            for name, mask in mdp.labels.items()
        },
    )


def dense(mdp: TabularMDP) -> tuple[Floats, Floats]:
    """Return T [S, A, S] and r [S, A] as dense arrays, filled by a plain loop."""
    transition = np.zeros((mdp.num_states, mdp.num_actions, mdp.num_states))
    reward = np.zeros((mdp.num_states, mdp.num_actions))
    for state in range(mdp.num_states):
        for choice in range(mdp.state_to_choice[state], mdp.state_to_choice[state + 1]):
            action = mdp.choice_action[choice]
            reward[state, action] = mdp.choice_reward[choice]
            for branch in range(mdp.choice_to_branch[choice], mdp.choice_to_branch[choice + 1]):
                transition[state, action, mdp.branch_target[branch]] = mdp.branch_prob[branch]
    return transition, reward


def assert_identical(one: TabularMDP, other: TabularMDP) -> None:
    """Every field is equal, to the last bit."""
    for declared in fields(TabularMDP):
        left, right = getattr(one, declared.name), getattr(other, declared.name)
        if declared.name == "labels":
            assert list(left) == list(right)
            for name in left:
                np.testing.assert_array_equal(left[name], right[name])
        elif left is None or isinstance(left, tuple):
            assert left == right
        else:
            np.testing.assert_array_equal(left, right, err_msg=declared.name)
