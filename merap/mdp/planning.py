"""Compute optimal values and policies of a known MDP, the oracle that learners are measured against.

Values are expected sums of discounted rewards. The end of a task needs no special case: it
is an absorbing state whose only choice earns 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from merap.errors import EngineError
from merap.mdp.csr import first_match, row_best
from merap.mdp.model import Floats, Ints, TabularMDP

# Value iteration halves its error in at most log(2) / (1 - discount) sweeps; 60 halvings
# pass from any reward to rounding error.
_HALVINGS = 60


@dataclass(frozen=True)
class FiniteHorizonPlan:
    """A best (or worst) policy for T steps and its value.

    Attributes:
        value: expected return from the initial distribution.
        values: float64 [T + 1, S], expected return of the steps from t on; `values[T]` is 0.
        actions: int64 [T, S], the action taken at time t, an index into the action names;
            -1 where a state has no choice. Among equally good ones the first choice.
    """

    value: float
    values: Floats
    actions: Ints


@dataclass(frozen=True)
class DiscountedPlan:
    """A best (or worst) stationary policy for an unbounded time and its value.

    Attributes:
        value: expected discounted return from the initial distribution.
        values: float64 [S].
        actions: int64 [S], as in `FiniteHorizonPlan`.
        error: bound on the error of every value, rounding included.
    """

    value: float
    values: Floats
    actions: Ints
    error: float


def choice_values(mdp: TabularMDP, values: Floats, discount: float = 1.0) -> Floats:
    """Return the value of each choice, given the values of its successors.

    Args:
        mdp: the model.
        values: float64 [S].
        discount: in [0, 1].

    Returns:
        float64 [C], r(s, a) + discount * sum of T(s, a, s') values(s').
    """
    expected_next: Floats = mdp.transitions @ values
    return mdp.choice_reward + discount * expected_next


def initial_value(mdp: TabularMDP, values: Floats) -> float:
    """Return the mean of float64 [S] values over the initial distribution."""
    return float(mdp.initial @ values)


def backward_induction(
    mdp: TabularMDP, horizon: int, discount: float = 1.0, *, maximise: bool = True
) -> FiniteHorizonPlan:
    """Compute the best (or worst) time-indexed policy (Puterman 2005, section 4.5).

    Args:
        mdp: the model.
        horizon: T, the number of steps.
        discount: in [0, 1].
        maximise: best or worst.
    """
    values = np.zeros((horizon + 1, mdp.num_states))
    actions = np.empty((horizon, mdp.num_states), dtype=np.int64)
    sweeps = _sweeps(mdp, horizon, discount, maximise=maximise)
    for t, (of_choices, of_states) in zip(reversed(range(horizon)), sweeps, strict=True):
        values[t] = of_states
        actions[t] = _chosen_actions(mdp, of_choices, of_states)
    return FiniteHorizonPlan(initial_value(mdp, values[0]), values, actions)


def optimum(mdp: TabularMDP, horizon: int, discount: float = 1.0) -> float:
    """Return the value of the best time-indexed policy over `horizon` steps, from the initial states."""
    return _extreme_value(mdp, horizon, discount, maximise=True)


def worst_value(mdp: TabularMDP, horizon: int, discount: float = 1.0) -> float:
    """Return the value of the worst time-indexed policy over `horizon` steps, from the initial states."""
    return _extreme_value(mdp, horizon, discount, maximise=False)


def _extreme_value(mdp: TabularMDP, horizon: int, discount: float, *, maximise: bool) -> float:
    values = np.zeros(mdp.num_states)
    for _ in range(horizon):
        values = row_best(choice_values(mdp, values, discount), mdp.state_to_choice, maximise=maximise)
    return initial_value(mdp, values)


def _sweeps(
    mdp: TabularMDP, count: int, discount: float, *, maximise: bool
) -> Iterator[tuple[Floats, Floats]]:
    """Yield the values of choices [C] and of states [S] with 1, 2, ... steps to go."""
    values = np.zeros(mdp.num_states)
    for _ in range(count):
        of_choices = choice_values(mdp, values, discount)
        values = row_best(of_choices, mdp.state_to_choice, maximise=maximise)
        yield of_choices, values


def _chosen_actions(mdp: TabularMDP, of_choices: Floats, of_states: Floats) -> Ints:
    chosen = first_match(of_choices, of_states, mdp.choice_state)
    return np.where(chosen >= 0, mdp.choice_action[chosen], -1)


def value_iteration(
    mdp: TabularMDP, discount: float, precision: float = 1e-9, *, maximise: bool = True
) -> DiscountedPlan:
    """Compute the best (or worst) discounted value over an unbounded time.

    Stops by MacQueen's bounds: after a sweep that changed the values by between `low` and
    `high`, the solution lies between values + low * g and values + high * g with
    g = discount / (1 - discount) (Puterman 2005, section 6.6). The middle is returned.

    Args:
        mdp: the model.
        discount: in [0, 1).
        precision: the largest error of a value that is allowed.
        maximise: best or worst.

    Raises:
        ValueError: the discount is outside [0, 1).
        EngineError: rounding errors keep the precision out of reach.
    """
    if not 0 <= discount < 1:
        raise ValueError(f"the discount must be in [0, 1), it is {discount}")
    gain = discount / (1 - discount)
    previous = np.zeros(mdp.num_states)
    limit = 2 + int(_HALVINGS / (1 - discount))
    for of_choices, of_states in _sweeps(mdp, limit, discount, maximise=maximise):
        change = of_states - previous
        low, high = float(change.min()) * gain, float(change.max()) * gain
        error = (high - low) / 2 + _sweep_rounding(mdp, previous) / (1 - discount)
        if error <= precision:
            # A state without choices keeps its value of 0.
            values = np.where(np.diff(mdp.state_to_choice) > 0, of_states + (low + high) / 2, 0.0)
            actions = _chosen_actions(mdp, of_choices, of_states)
            return DiscountedPlan(initial_value(mdp, values), values, actions, error)
        previous = of_states
    raise EngineError(f"value iteration is still up to {error:.1e} off after {limit} sweeps")


def _sweep_rounding(mdp: TabularMDP, values: Floats) -> float:
    """Bound the rounding error of one sweep over `values`: sums of K products and a reward."""
    terms = int(np.diff(mdp.choice_to_branch).max()) + 3
    scale = float(np.abs(values).max() + np.abs(mdp.choice_reward).max())
    return float(np.finfo(np.float64).eps) * terms * scale
