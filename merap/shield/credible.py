"""Outcome sets of a belief: what each action may lead to under any hypothesis still credible.

Hypotheses are never enumerated. What an action does in a state depends on the classes u, v of
environment and capability, on the slip w, and on which of its moves are open there (`belief.actions`).
So for each class it is enough to know, move by move, whether some credible hypothesis has it open and
whether some has it closed: a location that may be closed in an unknown way gives both, to move and to
stay. Of the slips only the least and the greatest count, since the outcome is linear in between. The
moves of one action are taken as independent, and the sets of all states and actions as a product:
more than the hypotheses together allow, never less.

Credible is what `models.credible_models` says, of each environment, capability and kind of outcomes, of each
objective, and, within an unknown environment or capability, of each location by itself.

Axes as in `belief.space` and `belief.actions`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.belief.actions import ActionTable
from merap.belief.cells import BOTH, KNOWN, NO_ENTRY, OBSTACLES, closed_probability
from merap.belief.model import known_open
from merap.belief.outside import other_goals
from merap.belief.posterior import Belief, concern_weights, weights
from merap.belief.space import HypothesisSpace
from merap.belief.steps import holds_in_states
from merap.belief.update import family
from merap.errors import InputError
from merap.mdp.model import Bools, Floats
from merap.shield.models import credible_models
from merap.shield.outcomes import OutcomeSets, outcome_sets
from merap.shield.successors import joined, successors

FAMILIES = (KNOWN, OBSTACLES, NO_ENTRY, BOTH)


@dataclass(frozen=True, eq=False)
class Credible:
    """What is left of a belief's hypotheses.

    Attributes:
        dynamics: bool [E, C, W].
        objective: bool [O].
        closed: bool [F, U, V, W, P], the location may be closed in an unknown way.
        open: bool [F, U, V, W, P], it may be open.
    """

    dynamics: Bools
    objective: Bools
    closed: Bools
    open: Bools

    def signature(self, belief: Belief) -> bytes:
        """Equal for equal outcome sets."""
        parts = (belief.environments, self.dynamics, self.objective, self.closed, self.open)
        return b"".join(np.ascontiguousarray(part).tobytes() for part in parts)


def credible(space: HypothesisSpace, belief: Belief, doubt: float) -> Credible:
    """What a belief has not refuted.

    Args:
        space: the hypotheses.
        belief: the posterior.
        doubt: see `credible_models`.
    """
    dynamics, _ = weights(belief)
    objective = concern_weights(space, belief)[2]
    unknown = closed_probability(belief.closed, belief.obstacle, space.closed)
    before = closed_probability(np.zeros_like(belief.closed), np.zeros_like(belief.obstacle), space.closed)
    return Credible(
        dynamics=credible_models(np.exp(space.prior)[belief.environments], dynamics, doubt),
        objective=credible_models(np.exp(space.objective_prior), objective, doubt),
        closed=credible_models(before, unknown, doubt),
        open=credible_models(1 - before, 1 - unknown, doubt),
    )


def unsafe_states(space: HypothesisSpace, *, required: bool = True) -> Bools:
    """bool [U, O, S]: where each objective says `unsafe`, by the environment's attributes.

    Raises:
        InputError: it is required, and no objective says what is unsafe.
    """
    supports = space.case.supports
    objectives = [*supports.objective, *other_goals(space.case)]
    if required and all(objective.unsafe is None for objective in objectives):
        raise InputError(
            "no objective says what is unsafe: there is nothing to shield from", source=str(space.case.source)
        )
    found = np.zeros((len(space.attributes), len(objectives), space.num_states), dtype=np.bool_)
    template = space.case.combine(0, 0, 0)
    for u in range(len(space.attributes)):
        environment = supports.environment[int(np.flatnonzero(space.attribute_class == u)[0])]
        for o, objective in enumerate(objectives):
            if objective.unsafe is not None:
                combination = replace(template, environment=environment, objective=objective)
                found[u, o] = holds_in_states(combination, objective.unsafe)
    return found


@dataclass(frozen=True, eq=False)
class _Moves:
    """What credible hypotheses of one class of environment and capability allow.

    Attributes:
        open: bool [P, L], some have the move open.
        closed: bool [P, L], some have it closed.
        kinds: indices of the kinds of outcomes, of those that slip the least and the greatest.
    """

    open: Bools
    closed: Bools
    kinds: tuple[int, ...]


def credible_outcomes(
    space: HypothesisSpace, belief: Belief, left: Credible, unsafe: Bools, hazards: Floats
) -> OutcomeSets:
    """Outcome sets on the canonical index.

    A step that completes the task under every credible hypothesis ends all risk, unless it leads to
    an unsafe state; one that may not complete it is followed further.

    Args:
        space: the hypotheses.
        belief: the posterior.
        left: what is credible of it.
        unsafe: bool [U, O, S].
        hazards: float64 [P], the probability that a location is hazardous.
    """
    classes = space.attribute_class[belief.environments]
    members = {
        (u, v): left.dynamics
        & ((classes == u)[:, np.newaxis] & (space.capability_class == v))[..., np.newaxis]
        for u in range(len(space.attributes))
        for v in range(int(space.capability_class.max()) + 1)
    }
    moves = {place: _moves(space, belief, left, place, part) for place, part in members.items() if part.any()}
    environments = sorted({u for u, _ in moves})
    by_objective = unsafe[environments][:, left.objective]
    avoided = np.append(by_objective.any(axis=(0, 1)), False)
    ends = np.asarray(space.ends[environments][:, left.objective].all(axis=(0, 1)))
    sure = np.ones((space.num_states + 1, len(space.actions)), dtype=np.bool_)
    found = []
    for number, table in enumerate(space.actions):
        states, probs = [], []
        for (u, v), allowed in moves.items():
            feasible = _feasible(space, table, allowed)
            sure[:-1, number] &= np.all(~feasible | table.enabled[v], axis=1)
            state, pattern = np.nonzero(feasible & table.enabled[v])
            for kind in allowed.kinds:
                slip = space.slips[kind]
                prob = (1 - slip) * table.prob[u, v, space.disturbance[kind], state, pattern]
                prob[:, 0] += slip
                states.append(state)
                probs.append(prob)
        led_to = successors(space, number, ends[number], avoided[:-1], hazards)
        found.append(led_to.rows(np.concatenate(states), np.concatenate(probs)))
    return outcome_sets(joined(found), sure, avoided, len(space.actions))


def _moves(
    space: HypothesisSpace, belief: Belief, left: Credible, place: tuple[int, int], part: Bools
) -> _Moves:
    kinds = family(space, belief)
    shape = space.space.target.shape
    is_open, is_closed = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    for kind in FAMILIES:
        mine = part & (kinds == kind)[..., np.newaxis]
        if not mine.any():
            continue
        count = mine.sum(axis=(0, 1))[:, np.newaxis, np.newaxis]  # [W, 1, 1]
        free = known_open(space, belief, mine.astype(np.float64))  # [W, P, L]
        some_free, some_shut = free > 0.5, free < count - 0.5
        may_close = left.closed[kind][place][:, space.space.target]
        may_open = left.open[kind][place][:, space.space.target]
        is_open |= (some_free & may_open).any(axis=0)
        is_closed |= (some_shut | (some_free & may_close)).any(axis=0)
    exists = space.space.target >= 0
    return _Moves(is_open & exists, is_closed | ~exists, _extremes(space, np.asarray(part.any(axis=(0, 1)))))


def _extremes(space: HypothesisSpace, kinds: Bools) -> tuple[int, ...]:
    """Of the kinds of outcomes bool [W] those that are not between two others."""
    undisturbed = np.flatnonzero(kinds & (space.disturbance == 0))
    disturbed = np.flatnonzero(kinds & (space.disturbance > 0))
    by_slip = undisturbed[np.argsort(space.slips[undisturbed], kind="stable")]
    return tuple(np.unique([*by_slip[:1], *by_slip[-1:], *disturbed]).tolist())


def _feasible(space: HypothesisSpace, table: ActionTable, allowed: _Moves) -> Bools:
    """bool [S, R]: some credible hypothesis may leave open exactly these moves of an action."""
    patterns = np.arange(2 ** len(table.moves))
    feasible = np.ones((space.space.num_locations, len(patterns)), dtype=np.bool_)
    for bit, move in enumerate(table.moves):
        is_open = (patterns >> bit) & 1 == 1
        feasible &= np.where(is_open, allowed.open[:, move, np.newaxis], allowed.closed[:, move, np.newaxis])
    return np.repeat(feasible, space.num_modes, axis=0)
