"""The hypotheses of a belief: the case's support, and what may lie outside it.

Environment: N of the support and, last, one with unknown obstacles. Capability: M of the support
and, last, for each of V capability classes (equal but for `no_entry`) one with unknown places it
can't enter. Both unknowns are independent location by location (`cells`). Outcomes: as the base says, or
with probability w an action does nothing at all (a slip), or other probabilities than any capability has
(`disturbances`). Objective: K of the support, and the same with the goal at any other location.

Axes: E = N + 1 environments, C = M + V capabilities, W kinds of outcomes, O objectives, Y noises, A actions,
P, S, U, V, G and K as in `actions`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from merap.belief.actions import ActionTable
from merap.belief.disturbances import disturbances, stacked
from merap.belief.outside import (
    Outside,
    closed_share,
    other_goals,
    outcome_shares,
    split,
    unknown_capabilities,
)
from merap.belief.states import belief_states, start_of
from merap.belief.steps import Steps, holds_in_states
from merap.concerns.case_study import DeclaredCase
from merap.concerns.combination import Capability, DeclaredCombination, DeclaredObjective
from merap.concerns.space import Space
from merap.errors import InputError
from merap.mdp.index import FamilyIndex, carried
from merap.mdp.model import Bools, Floats, Ints
from merap.mdp.short_repr import ShortRepr

MAX_TABLE = 100_000_000
MAX_OUTCOMES = 64
# Standard deviations of reward noise, in units of the range of all rewards. The first stands for
# none: a hundred-thousandth hides rounding and nothing else.
QUIET = 1e-5
NOISES = (0.01, 0.02, 0.05, 0.1, 0.2)


@dataclass(frozen=True, eq=False, repr=False)
class HypothesisSpace(ShortRepr):
    """All hypotheses about the real domain as arrays; made once for a case.

    Attributes:
        case: the case.
        space: P locations.
        states: S numbers of location and mode and, last, that of the completed state.
        index: the numbers that policies and masks outside the belief have.
        environment_names: E names, the last is the unknown one.
        capability_names: C names.
        objective_names: O names, those of the support first.
        num_objectives: K of the support.
        blocked: bool [E, P].
        blocked_edges: bool [E, P, L]; None if no environment has any.
        no_entry: bool [C, P].
        attribute_class: int64 [E], in 0..U - 1.
        capability_class: int64 [C], in 0..V - 1.
        attributes: float64 [U, number of attributes, P].
        outcome_names: W names; the first is what the base says.
        slips: float64 [W], the first is 0.
        disturbance: int64 [W], in 0..G - 1; 0 where there is a slip.
        actions: a table for each of A actions.
        reward: float64 [U, O, A, S, K], 0 in slots an action does not have.
        ends: bool [U, O, A, S, K], the step completes the task.
        noises: float64 [Y], standard deviations of the noise on rewards.
        noise_prior: float64 [Y].
        closed: prior probability of a location to be closed in an unknown way.
        prior: float64 [E, C, W], log.
        objective_prior: float64 [O], log.
        initial: float64 [S], start distribution of the support's first objective.
    """

    case: DeclaredCase
    space: Space
    states: FamilyIndex
    index: FamilyIndex
    environment_names: tuple[str, ...]
    capability_names: tuple[str, ...]
    objective_names: tuple[str, ...]
    num_objectives: int
    blocked: Bools
    blocked_edges: Bools | None
    no_entry: Bools
    attribute_class: Ints
    capability_class: Ints
    attributes: Floats
    outcome_names: tuple[str, ...]
    slips: Floats
    disturbance: Ints
    actions: tuple[ActionTable, ...]
    reward: Floats
    ends: Bools
    noises: Floats
    noise_prior: Floats
    closed: float
    prior: Floats
    objective_prior: Floats
    initial: Floats

    @property
    def num_modes(self) -> int:
        """Q."""
        return len(self.case.modes)

    @property
    def num_states(self) -> int:
        """S, without the completed state."""
        return self.states.num_states - 1

    def outward(self, table: npt.NDArray[Any], missing: Any) -> npt.NDArray[Any]:
        """Return a table [.., S + 1, A] of the belief's states for those of `index`."""
        return carried(table, self.states, self.index, missing)

    def inward(self, table: npt.NDArray[Any], missing: Any) -> npt.NDArray[Any]:
        """Return a table of the states of `index` for the belief's, [.., S + 1, A]."""
        return carried(table, self.index, self.states, missing)

    @property
    def sees_obstacles(self) -> bool:
        """Whether the system has a detector of obstacles."""
        return any(one.of == "blocked" for one in self.space.detectors)

    @cached_property
    def outcome_codes(self) -> Ints:
        """int64 [U, O, A, S, K], equal where reward and completion are (many rewards: are close)."""
        rewards = np.unique(np.round(self.reward, 9))
        if len(rewards) > MAX_OUTCOMES:
            rewards = np.quantile(rewards, np.linspace(0, 1, MAX_OUTCOMES))
        return 2 * np.searchsorted(rewards, np.round(self.reward, 9)) + self.ends


def hypothesis_space(
    case: DeclaredCase,
    outside: Outside | None = None,
    noise: float | None = None,
    index: FamilyIndex | None = None,
) -> HypothesisSpace:
    """All hypotheses of a case.

    Args:
        case: the case.
        outside: prior mass outside the support.
        noise: standard deviation of the Gaussian noise on rewards; None: it is estimated.
        index: the numbers that policies and masks have; None: those of the belief.

    Raises:
        InputError: the tables would be too large, an action has too many moves, or concerns read each other.
    """
    declared = outside or Outside()
    supports = case.supports
    if any(case.read_system.closing.foreign.values()):
        raise InputError(f"{case.name}: the belief takes no case whose concerns read each other's parameters")
    environments, capabilities = list(supports.environment), list(supports.capability)
    attribute_class, attribute_members = _classes([id(one.attributes) for one in environments])
    capability_class, capability_members = _classes([_dynamics(one) for one in capabilities])
    representatives = [[case.combine(e, c, 0) for c in capability_members] for e in attribute_members]
    disturbed = disturbances(case, capability_members, representatives, declared.odds)
    tables = stacked(disturbed)
    base = list(supports.objective)
    objectives = [*base, *other_goals(case)]
    blocked = np.stack([*(one.blocked for one in environments), np.zeros(case.space.num_locations, np.bool_)])
    unknown = np.zeros((len(capability_members), case.space.num_locations), dtype=np.bool_)
    no_entry = np.concatenate([np.stack([one.no_entry for one in capabilities]), unknown])
    edges = np.stack([one.blocked_edges for one in environments])
    reward, ends = _objective_tables(representatives, objectives, tables)
    commonest = int(np.bincount(attribute_class).argmax())
    noises, noise_prior = _noises(reward, noise)
    states = belief_states(representatives[0][0])
    return HypothesisSpace(
        case=case,
        space=case.space,
        states=states,
        index=states if index is None else index,
        environment_names=(*(one.name for one in environments), "unknown obstacles"),
        capability_names=(
            *(one.name for one in capabilities),
            *unknown_capabilities([capabilities[index].name for index in capability_members]),
        ),
        objective_names=tuple(one.name for one in objectives),
        num_objectives=len(base),
        blocked=blocked,
        blocked_edges=np.concatenate([edges, np.zeros_like(edges[:1])]) if edges.any() else None,
        no_entry=no_entry,
        attribute_class=np.append(attribute_class, commonest),
        capability_class=np.append(capability_class, np.arange(len(capability_members))),
        attributes=np.stack(
            [np.array([one.values for one in row[0].environment.attributes]) for row in representatives]
        ),
        outcome_names=(
            disturbed[0].name,
            *(f"slip {slip:g}" for slip in declared.slips),
            *(one.name for one in disturbed[1:]),
        ),
        slips=np.array((0.0, *declared.slips, *[0.0] * (len(disturbed) - 1))),
        disturbance=np.array((0, *[0] * len(declared.slips), *range(1, len(disturbed)))),
        actions=tables,
        reward=reward,
        ends=ends,
        noises=noises,
        noise_prior=noise_prior,
        closed=closed_share(declared, blocked[:-1], no_entry[: len(capabilities)]),
        prior=_prior(
            split(len(environments), 1, declared.environment),
            split(len(capabilities), len(capability_members), declared.capability),
            outcome_shares(declared, len(disturbed) - 1),
        ),
        objective_prior=np.log(split(len(base), len(objectives) - len(base), declared.objective)),
        initial=start_of(representatives[0][0]),
    )


def _classes(keys: Sequence[object]) -> tuple[Ints, list[int]]:
    """The class of each entry, and the first member of each class."""
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    members = {numbers[key]: index for index, key in reversed(list(enumerate(keys)))}
    return np.array([numbers[key] for key in keys]), [members[number] for number in range(len(numbers))]


def _dynamics(capability: Capability) -> tuple[object, ...]:
    """Return what two capabilities share that move and change mode alike."""
    innate = capability.innate
    if innate is None:
        return capability.external, None
    rows = tuple(
        (action.name, mode, target, share)
        for action in innate.actions
        for mode, row in action.chances.items()
        for target, share in row.items()
    )
    return capability.external, innate.entry, innate.initial, innate.terminal, innate.restart, rows


def _prior(environment: Floats, capability: Floats, slip: Floats) -> Floats:
    joint: Floats = np.log(environment[:, None, None] * capability[:, None] * slip)
    return joint


def _noises(reward: Floats, known: float | None) -> tuple[Floats, Floats]:
    """Standard deviations [Y] and their prior: no noise as likely as all the others together."""
    scale = float(np.ptp(reward)) or 1.0
    quiet = QUIET * scale
    if known is not None:
        return np.array([max(known, quiet)]), np.ones(1)
    return scale * np.array((QUIET, *NOISES)), split(1, len(NOISES), 0.5)


def _objective_tables(
    representatives: Sequence[Sequence[DeclaredCombination]],
    objectives: Sequence[DeclaredObjective],
    tables: Sequence[ActionTable],
) -> tuple[Floats, Bools]:
    """Rewards [U, O, A, S, K] and completions [U, O, A, S, K] of every objective."""
    width = max(table.target.shape[1] for table in tables)
    shape = (len(objectives), len(tables), len(tables[0].target), width)
    size = len(representatives) * int(np.prod(shape))
    if size > MAX_TABLE:
        raise InputError(f"the rewards of {shape[0]} objectives in {shape[2]} states are {size} numbers, "
                         f"at most {MAX_TABLE} are kept")  # fmt: skip
    slots = [(a, slot) for a, table in enumerate(tables) for slot in range(table.target.shape[1])]
    target = np.concatenate([tables[a].target[:, slot] for a, slot in slots])
    state = np.tile(np.arange(shape[2]), len(slots))
    action = np.repeat([a for a, _ in slots], shape[2])
    place = (action, state, np.repeat([slot for _, slot in slots], shape[2]))
    reward = np.zeros((len(representatives), *shape))
    ends = np.zeros_like(reward, dtype=np.bool_)
    for number, objective in enumerate(objectives):
        for u, row in enumerate(representatives):
            combination = replace(row[0], objective=objective)
            steps = Steps(combination, state, action, target)
            reward[(u, number, *place)] = steps.rewards()
            ends[(u, number, *place)] = _completes(combination, steps, target)
    return reward, ends


def _completes(combination: DeclaredCombination, steps: Steps, target: Ints) -> Bools:
    """bool [B]."""
    objective = combination.objective
    completes = np.zeros(len(target), dtype=np.bool_)
    if objective.ends_after is not None:
        completes |= steps.holds(objective.ends_after)
    if objective.ends_in is not None:
        completes |= holds_in_states(combination, objective.ends_in)[target]
    return completes
