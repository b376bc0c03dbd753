"""Lead a system back to a location by its own moves, in the fewest expected steps.

Axes: S states of environment and capability, C choices.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.errors import EngineError, InputError
from merap.mdp.csr import first_match, row_best
from merap.mdp.graph import surely_reaching
from merap.mdp.model import Bools, Ints, TabularMDP
from merap.program.completion import completed, enabled
from merap.program.expressions import negation
from merap.program.form import Program
from merap.systems.places import location_in, locations_in
from merap.systems.world import KEPT, ProgramWorlds, Values, World

PRECISION = 1e-9
MAX_SWEEPS = 1_000_000


def return_policy(model: TabularMDP, target: Bools) -> Ints:
    """Solve the stochastic shortest path (Bertsekas and Tsitsiklis 1991), every step of cost 1.

    Args:
        model: of environment and capability.
        target: bool [S], where it leads.

    Returns:
        int64 [S], the choice taken in each state; -1 where no policy is sure to get there.

    Raises:
        EngineError: a million sweeps of value iteration are not enough.
    """
    inside = surely_reaching(model, target)
    refused = np.bincount(model.branch_choice[~inside[model.branch_target]], minlength=model.num_choices) > 0
    steps = np.zeros(model.num_states)
    for _ in range(MAX_SWEEPS):
        of_choices = np.where(refused, np.inf, 1 + model.transitions @ steps)
        best = row_best(of_choices, model.state_to_choice, maximise=False)
        following = np.where(inside & ~target, best, 0.0)
        settled = np.abs(following - steps).max() <= PRECISION
        steps = following
        if settled:
            return np.where(inside, first_match(of_choices, best, model.choice_state), -1)
    raise EngineError(f"the way back is not found after {MAX_SWEEPS} sweeps")


class ReturnTrips:
    """Draw trips back to a location, each by the policy that is best for it; no objective ends them.

    Args:
        combination: for its space.
        program: its program, slip included.
    """

    def __init__(self, combination: DeclaredCombination, program: Program) -> None:
        self._combination = combination
        alone = replace(program, processes=program.moving, labels={}, rewards={})
        resting = completed(alone, negation(enabled(alone)), "rest")
        self._worlds = ProgramWorlds(resting, combination.action_names)
        self._policy = lru_cache(maxsize=KEPT)(self._solved)

    def travel(self, here: Values, there: Values, generator: np.random.Generator) -> int:
        """Draw a trip from a state to the location of another, and return its number of steps.

        Raises:
            InputError: the system can't be sure to get there.
        """
        world = self._worlds.holding(here)
        start = location_in(self._combination, there)
        arrived, choice = self._policy(world, start)
        state = world.number(here)
        assert state is not None
        if choice[state] < 0:
            names = self._combination.space.locations
            raise InputError(
                f"the system can't get back from {names[location_in(self._combination, here)]} to its start "
                f"{names[start]} by its own moves; reset it by `none` or `episodes`"
            )
        steps = 0
        while not arrived[state]:
            branch = world.simulator.successors.draw(int(choice[state]), generator.random())
            state = int(world.simulator.target[branch])
            steps += 1
        return steps

    def _solved(self, world: World, location: int) -> tuple[Bools, Ints]:
        """Return bool [S], the states in a location, and the policy that leads there."""
        arrived = locations_in(self._combination, world.model) == location
        return arrived, return_policy(world.model, arrived)
