"""Turn a model into a simulation: a canonical one, or a combination whose location is always known.

Axes: S states, V state variables, P locations, Q modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.concerns.combination import DeclaredCombination
from merap.concerns.steps import holds_in_states
from merap.concerns.synthesis import attach_everywhere
from merap.mdp.canonical import ABSORBING_VALUE
from merap.mdp.model import Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.mdp.simulation import Simulator, simulator
from merap.systems.return_policy import ReturnTrips
from merap.systems.slip import slipping_pair


@dataclass(frozen=True, eq=False)
class World:
    """The model and the sampler that draw the steps of a simulated system.

    Attributes:
        model: whose states are those of the simulation.
        simulator: simulator of the model.
        valuations: int64 [S, V], the valuation seen in each state.
        canonical: int64 [S], its number on the canonical index of the case.
    """

    model: TabularMDP
    simulator: Simulator
    valuations: Ints
    canonical: Ints


@dataclass(frozen=True, eq=False)
class LocatedWorld(World):
    """A world where the system has a location; state (p, q, done) has number 2 * (p * Q + q) + done.

    Attributes:
        combination: the configurations that are there.
        return_trips: the ways back to a start.
    """

    combination: DeclaredCombination
    return_trips: ReturnTrips

    def located(self, state: int) -> tuple[int, int]:
        """Return location and mode of a state."""
        return divmod(state // 2, len(self.combination.modes))

    def beginning(self, location: int) -> int:
        """Return the state in which a task begins at a location."""
        return 2 * (location * len(self.combination.modes) + self.combination.capability.initial_mode)

    def allows(self, state: int, other: DeclaredCombination) -> bool:
        """Tell whether a system that is in a state can go on under another combination."""
        location, _ = self.located(state)
        if other.environment.blocked[location] or other.capability.no_entry[location]:
            return False
        ends_in = other.objective.ends_in
        under_way = not self.simulator.completed[state]
        return not (under_way and ends_in is not None and holds_in_states(other, ends_in)[state // 2])


def canonical_world(model: TabularMDP) -> World:
    """Simulate a model on its canonical index; where a task is complete no location is known.

    Raises:
        ModelError: see `simulator`.
    """
    return World(model, simulator([model]), model.valuations, np.arange(model.num_states))


def located_world(combination: DeclaredCombination, slip: float) -> LocatedWorld:
    """Simulate a combination by its definition: rewards are those of each single step, not expected ones.

    Args:
        combination: the true one.
        slip: the probability that an action does nothing.

    Raises:
        InputError: the probability is not in [0, 1).
        ModelError: a reachable state has no action, or a task begins completed.
    """
    pair = slipping_pair(combination, slip)
    whole = attach_everywhere(pair, combination)
    done = whole.labels[COMPLETE_LABEL]
    seen = np.where(done[:, np.newaxis], ABSORBING_VALUE, whole.valuations[:, :-1])
    seen.flags.writeable = False
    number = np.where(done, pair.num_states, np.arange(whole.num_states) // 2)
    return LocatedWorld(whole, simulator([whole]), seen, number, combination, ReturnTrips(combination, pair))
