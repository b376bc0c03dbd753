"""Bayes' rule for what a managed system shows: where it is, what it can do, what a step did, detections.

No loop runs over hypotheses: the likelihood is a small table over (family, attribute class,
capability class, slip, pattern of open moves), gathered for all hypotheses at once.

Axes as in `space` and `cells`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from merap.belief.actions import ActionTable
from merap.belief.cells import BOTH, added, closed_probability, obstacle_probability, with_unknown
from merap.belief.posterior import MAX_COUPLED, Belief, coupled_by, open_moves, reweighted, weights
from merap.belief.space import HypothesisSpace
from merap.errors import InputError
from merap.mdp.model import Bools, Floats, Ints
from merap.systems.interface import Observation

# Values of a real attribute, when it is a matter of hitting one by luck.
MANY = 1e9


@dataclass(frozen=True)
class ObservedStep:
    """A step that was seen.

    Attributes:
        state: index of the state it began in.
        action: index of the action.
        target: index of the state it led to; S, the completed state, if the task ended.
        reward: as received, noise included.
    """

    state: int
    action: int
    target: int
    reward: float


def family(space: HypothesisSpace, belief: Belief) -> Ints:
    """int64 [E, C], what is unknown under each environment and capability."""
    unknown_environment = belief.environments == len(space.environment_names) - 1
    num_classes = space.capability_class[-1] + 1
    unknown_capability = np.arange(len(space.capability_names)) >= len(space.capability_names) - num_classes
    return np.asarray(unknown_environment[:, np.newaxis] + 2 * unknown_capability)


def observe_state(space: HypothesisSpace, belief: Belief, state: int, observation: Observation) -> Belief:
    """All that being in a state tells, after a reset, a step or a gap: S, the completed state, is nowhere.

    Raises:
        InputError: the detections can't be used.
    """
    if state < space.num_states:
        belief = observe_presence(space, belief, state)
        belief = observe_enabled(space, belief, state, observation.enabled)
    return observe_detections(space, belief, observation.detections)


def observe_presence(space: HypothesisSpace, belief: Belief, state: int) -> Belief:
    """The system is there, so the location is not closed."""
    location = state // space.num_modes
    closed = space.blocked[belief.environments, location][:, np.newaxis] | space.no_entry[:, location]
    if not closed.any() and np.all(belief.closed[..., location] == -np.inf):
        return belief
    evidence = belief.closed.copy()
    evidence[..., location] = -np.inf
    if closed.any():
        likelihood = np.where(closed[..., np.newaxis], -np.inf, np.zeros(len(space.slips)))
        belief = reweighted(belief, likelihood, None)
    return replace(belief, closed=evidence)


def observe_enabled(space: HypothesisSpace, belief: Belief, state: int, enabled: Bools) -> Belief:
    """Which actions are possible (bool [A]) tells which moves are open, and what the system can do."""
    for number, table in enumerate(space.actions):
        if table.telling[state]:
            match = (table.enabled[:, state] == enabled[number]).astype(np.float64)
            shape = (len(space.attributes), match.shape[0], len(space.slips), match.shape[1])
            likelihood = np.broadcast_to(match[np.newaxis, :, np.newaxis], shape)
            belief = _told_by_pattern(space, belief, table, state, likelihood)
    return belief


def observe_step(space: HypothesisSpace, belief: Belief, step: ObservedStep) -> Belief:
    """A transition, its reward, and whether it ended the task."""
    table = space.actions[step.action]
    slots = _slot_probabilities(space, table, step.state)
    log_reward = _log_rewards(space, step, table.target.shape[1])
    if step.target < space.num_states:
        match = table.target[step.state] == step.target
        if not match.any():
            return replace(belief, unexplained=belief.unexplained + 1)
        slots, log_reward = slots[..., match], log_reward[:, match]
    possible = slots.any(axis=tuple(range(slots.ndim - 1)))
    slots, log_reward = slots[..., possible], log_reward[:, possible]
    same = log_reward.size > 0 and bool(np.all(log_reward == log_reward[:1, :1]))
    if same:
        likelihood = slots.sum(axis=-1)
        return _told_by_pattern(space, belief, table, step.state, likelihood, log_reward[0, 0])
    return _coupled(space, belief, table, step.state, slots, log_reward)


def _slot_probabilities(space: HypothesisSpace, table: ActionTable, state: int) -> Floats:
    """float64 [U, V, W, R, K], with the slip: slot 0 is to stay."""
    prob = table.prob[:, :, space.disturbance, state]
    slips = space.slips[:, np.newaxis, np.newaxis]
    slots: Floats = (1 - slips) * prob
    slots[..., 0] += slips[..., 0] * table.enabled[:, state][np.newaxis, :, np.newaxis]
    return slots


def _log_rewards(space: HypothesisSpace, step: ObservedStep, num_slots: int) -> Floats:
    """float64 [U, K, O, Y], log-density of the reward and of having ended or not."""
    place = (slice(None), slice(None), step.action, step.state, slice(0, num_slots))
    expected, ends = space.reward[place], space.ends[place]
    deviation = (step.reward - expected[..., np.newaxis]) / space.noises
    density = -0.5 * deviation**2 - np.log(space.noises)
    agrees = ends == (step.target == space.num_states)
    return np.where(agrees[..., np.newaxis], density, -np.inf).transpose(0, 2, 1, 3)


def _told_by_pattern(
    space: HypothesisSpace,
    belief: Belief,
    table: ActionTable,
    state: int,
    likelihood: Floats,
    objective: Floats | None = None,
) -> Belief:
    """An observation whose likelihood depends on the pattern of open moves and, apart, on the objective.

    Args:
        space: the hypotheses.
        belief: the prior.
        table: of the action.
        state: where it is taken.
        likelihood: float64 [U, V, W, R].
        objective: float64 [O, Y], log-likelihood; None: it says nothing.
    """
    if np.all(likelihood == likelihood.flat[0]) and likelihood.flat[0] > 0:
        return reweighted(belief, None, objective)
    averaged = with_unknown(likelihood, _unknown_closed(space, belief, table, state))
    updated = reweighted(belief, _gathered(space, belief, table, state, _log(averaged)), objective)
    if updated.unexplained > belief.unexplained:
        return updated
    return replace(updated, closed=_evidence(space, belief, table, state, likelihood))


def _gathered(
    space: HypothesisSpace, belief: Belief, table: ActionTable, state: int, averaged: Floats
) -> Floats:
    """float64 [E, C, W, ...] from a table [F, U, V, W, R, ...]."""
    is_open = open_moves(space, belief, state // space.num_modes, table.moves)
    pattern = (is_open << np.arange(len(table.moves))).sum(axis=2)
    attributes = space.attribute_class[belief.environments][:, np.newaxis]
    by_pattern = np.moveaxis(averaged, 3, 4)
    gathered: Floats = by_pattern[family(space, belief), attributes, space.capability_class, pattern]
    return gathered


def _unknown_closed(space: HypothesisSpace, belief: Belief, table: ActionTable, state: int) -> Floats:
    """float64 [F, U, V, W, k], that a move's target is closed in an unknown way."""
    targets = space.space.target[state // space.num_modes, list(table.moves)]
    return closed_probability(belief.closed[..., targets], belief.obstacle[targets], space.closed)


def _evidence(
    space: HypothesisSpace, belief: Belief, table: ActionTable, state: int, likelihood: Floats
) -> Floats:
    """Evidence [U, V, W, P] with what the observation tells of each move's target.

    With several moves the others are averaged out, each with the probability it had before
    (assumed-density filtering); with one move this is exact.
    """
    location = state // space.num_modes
    unknown = _unknown_closed(space, belief, table, state)[BOTH:]
    evidence = belief.closed.copy()
    targets = space.space.target[location, list(table.moves)]
    all_open = int(((targets >= 0) << np.arange(len(targets))).sum())
    for bit in np.flatnonzero(targets >= 0):
        others = unknown.copy()
        others[..., bit] = 0.0
        averaged = with_unknown(likelihood, others)[0]
        closed, is_open = averaged[..., all_open ^ (1 << bit)], averaged[..., all_open]
        evidence[..., targets[bit]] = added(evidence[..., targets[bit]], closed, is_open)
    return evidence


def _coupled(
    space: HypothesisSpace,
    belief: Belief,
    table: ActionTable,
    state: int,
    slots: Floats,
    log_reward: Floats,
) -> Belief:
    """An observation whose likelihood is no product of dynamics and objective."""
    scale = log_reward.max(initial=-np.inf)
    if not np.isfinite(scale):
        return replace(belief, unexplained=belief.unexplained + 1)
    density = np.exp(log_reward - scale)  # [U, K, O, Y]
    averaged = with_unknown(slots, _unknown_closed(space, belief, table, state))
    by_slot = _gathered(space, belief, table, state, averaged)  # [E, C, W, K]
    attributes = space.attribute_class[belief.environments]
    dynamics, objective = weights(belief)
    by_class = np.einsum("ukoy,oy->uk", density, objective)
    evidence = _evidence(space, belief, table, state, np.einsum("uvwrk,uk->uvwr", slots, by_class))
    if by_slot[..., 0].size * objective.size <= MAX_COUPLED:
        joint = np.einsum("ecwk,ekoy->ecwoy", by_slot, density[attributes], optimize=True)
        updated = coupled_by(belief, _log(joint))
    else:
        shares = np.zeros((len(density), by_slot.shape[3]))
        np.add.at(shares, attributes, np.einsum("ecw,ecwk->ek", dynamics, by_slot))
        of_objective = _log(np.einsum("uk,ukoy->oy", shares, density))
        of_dynamics = _log(np.einsum("ecwk,ek->ecw", by_slot, by_class[attributes]))
        updated = reweighted(belief, of_dynamics, of_objective)
    return replace(updated, closed=evidence)


def observe_detections(space: HypothesisSpace, belief: Belief, detections: Mapping[str, object]) -> Belief:
    """Readings of the case's detectors: name -> {location name: value}.

    A reading is right with the detector's accuracy, independently of all others; a wrong one of an
    attribute with more than two values is any other of them, and of a real one hardly ever a
    number that another hypothesis has there.

    Raises:
        InputError: a detector or location is unknown, or readings have another form.
    """
    known = {detector.name: detector for detector in space.space.detectors}
    for name, readings in detections.items():
        if name not in known or not isinstance(readings, Mapping):
            raise InputError(
                f"unexpected detection {name!r}: {readings!r}; a reading maps locations to values"
            )
        locations = np.array([_location(space, place) for place in readings], dtype=np.int64)
        values = np.array([float(value) for value in readings.values()])
        if len(locations) == 0:
            continue
        detector = known[name]
        if detector.of == "blocked":
            belief = _saw_obstacles(space, belief, locations, values > 0, detector.accuracy)
        else:
            belief = _saw_attribute(space, belief, detector.of, locations, values, detector.accuracy)
    return belief


def _location(space: HypothesisSpace, name: object) -> int:
    if name not in space.space.location_index:
        raise InputError(f"a detection names the unknown location {name!r}")
    return space.space.location_index[str(name)]


def _saw_obstacles(
    space: HypothesisSpace, belief: Belief, locations: Ints, seen: Bools, accuracy: float
) -> Belief:
    right = np.where(seen, accuracy, 1 - accuracy)  # likelihood if there is an obstacle, [M]
    wrong = np.where(seen, 1 - accuracy, accuracy)
    unknown = obstacle_probability(
        belief.closed[..., locations], belief.obstacle[locations], space.closed
    )  # [F, U, V, W, M]
    kinds = family(space, belief)
    attributes = space.attribute_class[belief.environments][:, np.newaxis]
    chance = unknown[kinds, attributes, space.capability_class]  # [E, C, W, M]
    held = space.blocked[belief.environments][:, np.newaxis, np.newaxis, locations]
    chance = np.where(held, 1.0, chance)
    updated = reweighted(belief, _log(chance * right + (1 - chance) * wrong).sum(axis=-1), None)
    evidence = belief.obstacle.copy()
    evidence[locations] = added(evidence[locations], right, wrong)
    return replace(updated, obstacle=evidence)


def _saw_attribute(
    space: HypothesisSpace, belief: Belief, name: str, locations: Ints, values: Floats, accuracy: float
) -> Belief:
    declared = [attribute.name for attribute in space.space.attributes]
    attribute = space.space.attributes[declared.index(name)]
    others = {"bool": 1.0, "int": attribute.high - attribute.low, "real": MANY}[attribute.kind]
    actual = space.attributes[:, declared.index(name)][:, locations]
    likelihood = _log(np.where(actual == values, accuracy, (1 - accuracy) / max(others, 1.0))).sum(
        axis=1
    )  # [U]
    by_environment = likelihood[space.attribute_class[belief.environments]]
    return reweighted(
        belief, by_environment[:, np.newaxis, np.newaxis] + np.zeros_like(belief.dynamics), None
    )


def _log(likelihood: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        logarithm: Floats = np.log(likelihood)
    return logarithm
