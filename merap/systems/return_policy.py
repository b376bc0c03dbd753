"""Lead a system back to a location by its own moves, in the fewest expected steps.

Axes: P locations, Q modes, C choices. State (p, q) has index p * Q + q.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.errors import EngineError, InputError
from merap.mdp.csr import first_match, row_best
from merap.mdp.graph import surely_reaching
from merap.mdp.model import Ints, TabularMDP
from merap.mdp.reserved_names import END_ACTION
from merap.mdp.simulation import simulator

PRECISION = 1e-9
MAX_SWEEPS = 1_000_000


@dataclass(frozen=True, eq=False)
class ReturnPolicy:
    """A policy that leads to a location almost surely.

    Attributes:
        location: where it leads.
        choice: int64 [P * Q], the choice taken in each state; -1 where it can't lead there.
    """

    location: int
    choice: Ints


def return_policy(pair: TabularMDP, location: int) -> ReturnPolicy:
    """Solve the stochastic shortest path (Bertsekas and Tsitsiklis 1991), every step of cost 1.

    Args:
        pair: environment and capability, from `synthesise_pair` or `slipping_pair`.
        location: index of the target, in any mode.

    Raises:
        EngineError: a million sweeps of value iteration are not enough.
    """
    num_modes = int(pair.valuations[:, -1].max()) + 1
    target = np.arange(pair.num_states) // num_modes == location
    inside = surely_reaching(pair, target)
    leaving = np.bincount(pair.branch_choice[~inside[pair.branch_target]], minlength=pair.num_choices) > 0
    refused = leaving | (pair.choice_action == pair.action_names.index(END_ACTION))
    steps = np.zeros(pair.num_states)
    for _ in range(MAX_SWEEPS):
        of_choices = np.where(refused, np.inf, 1 + pair.transitions @ steps)
        best = row_best(of_choices, pair.state_to_choice, maximise=False)
        following = np.where(inside & ~target, best, 0.0)
        settled = np.abs(following - steps).max() <= PRECISION
        steps = following
        if settled:
            choice = first_match(of_choices, best, pair.choice_state)
            return ReturnPolicy(location, np.where(inside, choice, -1))
    raise EngineError(f"the way back to location {location} is not found after {MAX_SWEEPS} sweeps")


class ReturnTrips:
    """Draw trips back to a location, each by the policy that is best for it.

    Args:
        combination: for its names.
        pair: its environment and capability, slip included.
    """

    def __init__(self, combination: DeclaredCombination, pair: TabularMDP) -> None:
        self._combination = combination
        self._pair = pair
        self._simulator = simulator([pair])
        self._policies: dict[int, ReturnPolicy] = {}

    def travel(self, state: int, location: int, generator: np.random.Generator) -> int:
        """Draw a trip from a state (p, q) to a location, and return its number of steps.

        Raises:
            InputError: the system can't be sure to get there.
        """
        if location not in self._policies:
            self._policies[location] = return_policy(self._pair, location)
        policy = self._policies[location]
        num_modes = len(self._combination.modes)
        if policy.choice[state] < 0:
            names = self._combination.space.locations
            raise InputError(
                f"the system can't get back from {names[state // num_modes]} to its start {names[location]} "
                "by its own moves; reset it by `none` or `episodes`"
            )
        steps = 0
        while state // num_modes != location:
            branch = self._simulator.successors.draw(int(policy.choice[state]), generator.random())
            state = int(self._simulator.target[branch])
            steps += 1
        return steps
