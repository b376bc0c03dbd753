"""Define the interface that all strategies share.

A strategy sees the system through the observations of `ManagedSystem.reset` and `step`, and nothing else.

Axes: T steps of an episode, S states of the index, A declared actions.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate
from typing import Protocol, runtime_checkable

import numpy as np

from merap.errors import InputError
from merap.mdp.index import FamilyIndex
from merap.mdp.model import Bools, Floats
from merap.systems.interface import Observation


class Strategy(Protocol):
    """Acts, learns from what it sees, and says what it would do if it learned no more.

    The order of calls: `begin`, then `act` and `observe` until the episode is over, with another `begin`
    after each gap in the observations, and `update` after every `episodes_per_update` episodes.
    """

    @property
    def episodes_per_update(self) -> int:
        """Number of real episodes that a policy update takes."""

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """Begin an episode, or take it up where it is first seen or goes on after unseen steps.

        Args:
            observation: where the system is.
            time: number of steps of the episode that are over.
            resumed: whether it is the same episode as before.
        """

    def act(self, allowed: Bools) -> int:
        """Choose the next action, exploration included.

        Args:
            allowed: bool [A], not empty: the enabled actions, or what a shield leaves of them.
        """

    def observe(self, action: int, observation: Observation) -> None:
        """Learn from the outcome of a step; `observation.last` if the episode is over."""

    def update(self) -> None:
        """Change the policy by the observations so far."""

    def policy(self) -> Floats:
        """Return the policy that would act if learning stopped now, float64 [S, A] or, by time, [T, S, A].

        A distribution in every state that isn't complete. Where it favours actions that turn out
        to be disabled, the others count in proportion to their probabilities.
        """

    def explain(self) -> tuple[str, ...]:
        """Tell in plain lines the conclusions of the last update, and why the policy is what it is."""


@runtime_checkable
class Revisable(Protocol):
    """A strategy that remembers what it has seen of the domain, beside the policy."""

    def revise(self) -> None:
        """Doubt the observations of a domain that has changed, and keep what the policy has become."""


class StateIndex:
    """Look up the number of an observed state; where the task is complete it is any completed state's.

    Args:
        index: S states.
    """

    def __init__(self, index: FamilyIndex) -> None:
        rows = np.flatnonzero(~index.is_completed)
        valuations = map(tuple, index.valuations[rows].tolist())
        self._number = dict(zip(valuations, rows.tolist(), strict=True))
        self._completed = min(index.completed.values(), default=-1)

    def __call__(self, observation: Observation) -> int:
        """Return the state's number.

        Raises:
            InputError: the case has no such state.
        """
        if observation.continuation == 0:
            return self._completed
        values = tuple(observation.valuation.tolist())
        number = self._number.get(values)
        if number is None:
            raise InputError(f"the observed state {values} is none of the {len(self._number)} known ones")
        return number


def best_allowed(ranked: Floats, allowed: Bools) -> int:
    """Return the best of the allowed actions.

    Args:
        ranked: float64 [A], the value of each action.
        allowed: bool [A], not empty.
    """
    return int(np.where(allowed, ranked, -np.inf).argmax())


def draw_action(shares: Floats, allowed: Bools, uniform: float) -> int:
    """Draw an action by inversion from a row of a policy, among the allowed ones.

    It is plain Python, since the calls of numpy cost more than a few additions.

    Args:
        shares: float64 [A], at least 0; where nothing of them is allowed, allowed actions are equal.
        allowed: bool [A], not empty.
        uniform: in [0, 1).
    """
    mask = allowed.tolist()
    weights = [share if open_ else 0.0 for share, open_ in zip(shares.tolist(), mask, strict=True)]
    bounds = list(accumulate(weights))
    if bounds[-1] == 0:
        bounds = list(accumulate(map(float, mask)))
    # a product with a number below 1 may still be rounded up to the last bound
    return bisect_right(bounds, min(uniform * bounds[-1], math.nextafter(bounds[-1], 0)))
