"""Compare two models: states by valuation, actions by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from merap.errors import ModelError
from merap.mdp.alignment import align_actions, align_variables
from merap.mdp.matching import match_rows
from merap.mdp.model import Bools, Floats, Ints, TabularMDP

_PER_KIND = 3  # differences of one kind that are described


@dataclass(frozen=True)
class Comparison:
    """The result of comparing two models over their reachable states.

    Attributes:
        same_states: each reachable valuation of one is one of the other.
        same_actions: states in both have the same enabled actions.
        same_probabilities: choices in both lead to the same distribution.
        same_rewards: choices in both have the same expected reward.
        same_initial: the initial distributions are the same.
        same_labels: labels that both have hold in the same states.
        max_probability_difference: largest absolute difference over choices in both.
        max_reward_difference: likewise.
        max_initial_difference: largest absolute difference over states.
        differences: up to three of each kind in words, one line each.
    """

    same_states: bool
    same_actions: bool
    same_probabilities: bool
    same_rewards: bool
    same_initial: bool
    same_labels: bool
    max_probability_difference: float
    max_reward_difference: float
    max_initial_difference: float
    differences: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Tell whether there is no difference beyond the tolerances."""
        return not self.differences

    def require_same(self) -> None:
        """Refuse models that are not the same.

        Raises:
            ModelError: they differ; the message lists the differences.
        """
        if self.differences:
            raise ModelError("the models differ: " + "; ".join(self.differences))


@dataclass(frozen=True)
class _Side:
    """One of the two models, on the common numbers of states and actions.

    Attributes:
        state: int64 [S], the common number of a reachable state; -1 for another.
        present: bool [U], whether it has each of the U common states.
        key: int64 [choices], common state * A + common action, of reachable choices.
        reward: float64 [choices].
        transitions: float64 [choices, U] sparse.
        initial: float64 [U].
    """

    state: Ints
    present: Bools
    key: Ints
    reward: Floats
    transitions: csr_array
    initial: Floats


@dataclass(frozen=True)
class _Names:
    """Describes common numbers of states and of choices (state * A + action) in words."""

    variables: tuple[str, ...]
    actions: tuple[str, ...]
    valuations: Ints

    def state(self, number: int) -> str:
        pairs = zip(self.variables, self.valuations[number], strict=True)
        return "(" + ", ".join(f"{name}={value}" for name, value in pairs) + ")"

    def choice(self, key: int) -> str:
        state, action = divmod(key, len(self.actions))
        return f"{self.state(state)}, action {self.actions[action] or '(unnamed)'}"


def compare(
    a: TabularMDP, b: TabularMDP, probability_tolerance: float = 1e-12, reward_tolerance: float = 1e-9
) -> Comparison:
    """Compare two models over their reachable states.

    Args:
        a: the first model.
        b: the second, with the same variables in any order; states and actions may be
            numbered otherwise.
        probability_tolerance: largest difference of a probability that counts as none,
            also of the initial distribution.
        reward_tolerance: largest difference of an expected reward that counts as none.

    Raises:
        ModelError: a variable exists only in one of the two.
    """
    state_a, state_b, valuations = _common_states(a, b)
    actions = a.action_names + tuple(name for name in b.action_names if name not in a.action_names)
    names = _Names(a.variable_names, actions, valuations)
    first, second = _side(a, state_a, names), _side(b, state_b, names)
    key, of_first, of_second = np.intersect1d(first.key, second.key, assume_unique=True, return_indices=True)
    deviation = np.abs(first.transitions[of_first] - second.transitions[of_second])
    # scipy has no maximum over no rows.
    probability = deviation.max(axis=1).toarray().reshape(-1) if len(key) else np.zeros(0)
    reward_pair = first.reward[of_first], second.reward[of_second]
    reward = np.abs(reward_pair[0] - reward_pair[1])
    initial = np.abs(first.initial - second.initial)

    states = _one_sided(first.present, second.present, names, "state")
    enabled = _action_differences(first, second, names)
    probabilities = [
        f"{names.choice(int(key[row]))}: probabilities differ by up to {probability[row]:.3g}"
        for row in _first(probability > probability_tolerance)
    ]
    rewards = [
        f"{names.choice(int(key[row]))}: {_pair_text('reward', *reward_pair, row)}"
        for row in _first(reward > reward_tolerance)
    ]
    initials = [
        f"{names.state(state)}: {_pair_text('initial probability', first.initial, second.initial, state)}"
        for state in _first(initial > probability_tolerance)
    ]
    labels = _label_differences(a, b, first, second, names)
    return Comparison(
        same_states=not states,
        same_actions=not enabled,
        same_probabilities=not probabilities,
        same_rewards=not rewards,
        same_initial=not initials,
        same_labels=not labels,
        max_probability_difference=float(probability.max(initial=0.0)),
        max_reward_difference=float(reward.max(initial=0.0)),
        max_initial_difference=float(initial.max(initial=0.0)),
        differences=(*states, *enabled, *probabilities, *rewards, *initials, *labels),
    )


def _pair_text(noun: str, one: Floats, other: Floats, index: int) -> str:
    return f"{noun} {one[index]} in the first, {other[index]} in the second"


def _common_states(a: TabularMDP, b: TabularMDP) -> tuple[Ints, Ints, Ints]:
    """Return common numbers of the states of both, -1 for unreachable ones; int64 [U, V] valuations."""
    columns = align_variables(b, a.variable_names)
    of_a, of_b = np.flatnonzero(a.reachable), np.flatnonzero(b.reachable)
    place = match_rows(columns[of_b], a.valuations[of_a])
    fresh = place < 0
    place[fresh] = len(of_a) + np.arange(np.count_nonzero(fresh))
    state_a = np.full(a.num_states, -1)
    state_a[of_a] = np.arange(len(of_a))
    state_b = np.full(b.num_states, -1)
    state_b[of_b] = place
    return state_a, state_b, np.vstack((a.valuations[of_a], columns[of_b[fresh]]))


def _side(mdp: TabularMDP, state: Ints, names: _Names) -> _Side:
    size = len(names.valuations)
    choices = np.flatnonzero(mdp.reachable[mdp.choice_state])
    action = align_actions(mdp, names.actions)[mdp.choice_action[choices]]
    present = np.zeros(size, dtype=np.bool_)
    present[state[mdp.reachable]] = True
    initial = np.zeros(size)
    initial[state[mdp.reachable]] = mdp.initial[mdp.reachable]
    rows = mdp.transitions[choices].tocoo()
    return _Side(
        state=state,
        present=present,
        key=state[mdp.choice_state[choices]] * len(names.actions) + action,
        reward=mdp.choice_reward[choices],
        transitions=csr_array(
            (rows.data, (rows.coords[0], state[rows.coords[1]])), shape=(len(choices), size)
        ),
        initial=initial,
    )


def _first(mask: Bools) -> list[int]:
    found: list[int] = np.flatnonzero(mask)[:_PER_KIND].tolist()
    return found


def _one_sided(in_first: Bools, in_second: Bools, names: _Names, noun: str) -> list[str]:
    return [f"{noun} {names.state(state)} only in the first" for state in _first(in_first & ~in_second)] + [
        f"{noun} {names.state(state)} only in the second" for state in _first(in_second & ~in_first)
    ]


def _action_differences(first: _Side, second: _Side, names: _Names) -> list[str]:
    shared = first.present & second.present
    lines = []
    for one, other, where in ((first, second, "first"), (second, first, "second")):
        alone = np.setdiff1d(one.key, other.key, assume_unique=True)
        alone = alone[shared[alone // len(names.actions)]][:_PER_KIND]
        lines += [f"{names.choice(int(key))}: enabled only in the {where}" for key in alone]
    return lines


def _label_differences(a: TabularMDP, b: TabularMDP, first: _Side, second: _Side, names: _Names) -> list[str]:
    shared = first.present & second.present
    lines = []
    for label in a.labels:
        if label not in b.labels:
            continue
        holds = np.zeros((2, len(shared)), dtype=np.bool_)
        holds[0, first.state[a.reachable]] = a.labels[label][a.reachable]
        holds[1, second.state[b.reachable]] = b.labels[label][b.reachable]
        lines += _one_sided(holds[0] & shared, holds[1] & shared, names, f"label {label!r} at")
    return lines
