"""How much of a belief's prior lies outside the base, and what is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.concerns.case_study import DeclaredCase
from merap.concerns.combination import DeclaredObjective
from merap.concerns.parameters import held_locations
from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.mdp.reserved_names import GOAL_LABEL

# However many locations the support closes, an unknown world is mostly open.
MOST_CLOSED = 0.3


@dataclass(frozen=True)
class Outside:
    """How much of the prior lies outside the base, for each kind of surprise.

    Attributes:
        environment: obstacles at any location.
        capability: no entry at any location.
        objective: the goal at any location.
        slip: actions that do nothing more often than the base says.
        outcomes: outcome probabilities that no capability of the base has.
        closed: probability that a location is closed under the first two kinds; None: as
            many locations as the support closes on average, at least one.
        slips: probabilities of an action to do nothing, equally likely.
        odds: factors on the odds of outcomes, equally likely.
    """

    environment: float = 0.05
    capability: float = 0.05
    objective: float = 0.05
    slip: float = 0.05
    outcomes: float = 0.05
    closed: float | None = None
    slips: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4)
    odds: tuple[float, ...] = (0.1, 0.3, 3.0, 10.0)

    def __post_init__(self) -> None:
        for name in ("environment", "capability", "objective", "slip", "outcomes"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(
                    f"the mass outside the base must be in (0, 1), {name} has {getattr(self, name)}"
                )
        if not self.slips or not all(0 < slip < 1 for slip in self.slips):
            raise InputError(f"slips must be probabilities in (0, 1), not {self.slips}")
        if self.slip + self.outcomes >= 1:
            raise InputError(
                f"slip and outcomes must leave mass to the base, {self.slip} and {self.outcomes} do not"
            )
        if not all(0 < factor < np.inf for factor in self.odds):
            raise InputError(f"odds must be positive factors, not {self.odds}")


def split(inside: int, outside: int, mass: float) -> Floats:
    """The prior of one concern.

    Returns:
        float64 [inside + outside]; `mass` is shared by those outside, if there are any.
    """
    if outside == 0:
        return np.full(inside, 1 / inside)
    return np.concatenate([np.full(inside, (1 - mass) / inside), np.full(outside, mass / outside)])


def outcome_shares(declared: Outside, num_disturbances: int) -> Floats:
    """The prior of outcomes as the base says, of each slip, and of each disturbance."""
    slip = declared.slip / len(declared.slips)
    disturbed = declared.outcomes / num_disturbances if num_disturbances else 0.0
    shares = np.array([0.0, *[slip] * len(declared.slips), *[disturbed] * num_disturbances])
    shares[0] = 1 - shares.sum()
    return shares


def closed_share(declared: Outside, blocked: Bools, no_entry: Bools) -> float:
    """The prior probability of a location to be closed in an unknown way.

    Args:
        declared: by the caller.
        blocked: bool [N, P], of the support.
        no_entry: bool [M, P], of the support.
    """
    if declared.closed is not None:
        return declared.closed
    average = blocked.sum(axis=1).mean() + no_entry.sum(axis=1).mean()
    return float(min(max(1.0, average) / blocked.shape[1], MOST_CLOSED))


def unknown_capabilities(like: Sequence[str]) -> list[str]:
    """Names of the capabilities with unknown places they can't enter, one for each class."""
    if len(like) == 1:
        return ["unknown no-entry"]
    return [f"unknown no-entry, else {name}" for name in like]


def other_goals(case: DeclaredCase) -> list[DeclaredObjective]:
    """Each objective of the support with its goal at every location no such objective has it at."""
    support = case.supports.objective
    listed = [dict(support.configurations.values(index)) for index in range(support.count)]
    if GOAL_LABEL not in listed[0]:
        return []
    many = isinstance(listed[0][GOAL_LABEL], tuple)
    taken = {location for values in listed for location in held_locations(values, GOAL_LABEL)}
    free = [location for location in range(case.space.num_locations) if location not in taken]
    without = [{name: value for name, value in values.items() if name != GOAL_LABEL} for values in listed]
    distinct = [rest for index, rest in enumerate(without) if rest not in without[:index]]
    return [
        support.resolve(
            f"goal_{case.space.locations[location]}" + (f"_{number}" if len(distinct) > 1 else ""),
            {**rest, GOAL_LABEL: (location,) if many else location},
        )
        for number, rest in enumerate(distinct)
        for location in free
    ]
