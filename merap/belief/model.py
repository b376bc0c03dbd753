"""The analyzer's model of the real domain: the mean of a belief, or a sample of it.

Axes as in `space`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from merap.belief.actions import ActionTable
from merap.belief.cells import BOTH, KNOWN, NO_ENTRY, OBSTACLES, closed_probability
from merap.belief.posterior import Belief, weights
from merap.belief.space import HypothesisSpace
from merap.belief.update import family
from merap.mdp.assembly import Branches, assemble
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, END_ACTION

# Actions that are possible with less than this probability are left out of a plan.
POSSIBLE = 1e-6
# Rounding leaves certainty off by less.
CERTAIN = 1e-12


@dataclass(frozen=True, eq=False)
class DomainModel:
    """A Markov decision process as padded arrays, on the canonical index without the completed state.

    Attributes:
        target: int64 [A, S, K], successor of each slot.
        prob: float64 [A, S, K], sums to 1 where the action is possible; where the belief holds
            it possible only with some probability, the rest stays.
        enabled: bool [A, S].
        reward: float64 [A, S, K], expected.
        continuation: float64 [A, S, K], probability that the step does not complete the task.
    """

    target: Ints
    prob: Floats
    enabled: Bools
    reward: Floats
    continuation: Floats


def mean_model(space: HypothesisSpace, belief: Belief) -> DomainModel:
    """The posterior mean: of dynamics and objective, each by its marginal.

    The moves of an action that has several are taken as independent of each other.
    """
    dynamics, objective = weights(belief)
    return _model(space, *_open_mass(space, belief, dynamics), objective.sum(axis=1))


def mean_and_optimistic(
    space: HypothesisSpace, belief: Belief, doubt: float
) -> tuple[DomainModel, DomainModel]:
    """Return the mean model, and the same with each move open that is with probability `doubt` or more."""
    dynamics, objective = weights(belief)
    total, is_open = _open_mass(space, belief, dynamics)
    share = is_open.sum(axis=(0, 1, 2)) / total.sum()
    optimistic = np.where(share >= doubt, total[..., np.newaxis, np.newaxis], is_open)
    mean = _model(space, total, is_open, objective.sum(axis=1))
    prob, enabled = _transitions(space, total, optimistic)
    return mean, replace(mean, prob=prob, enabled=enabled)


def sampled_model(space: HypothesisSpace, belief: Belief, generator: np.random.Generator) -> DomainModel:
    """A hypothesis drawn from the posterior (Thompson sampling)."""
    dynamics, objective = weights(belief)
    row, capability, kind = np.unravel_index(_drawn(dynamics, generator), dynamics.shape)
    picked = np.zeros((1, *dynamics.shape[1:]))
    picked[0, capability, kind] = 1.0
    goal = np.zeros(len(objective))
    goal[_drawn(objective.sum(axis=1), generator)] = 1.0
    alone = replace(belief, environments=belief.environments[[row]])
    total, is_open = _open_mass(space, alone, picked, generator)
    return _model(space, total, is_open, goal)


def _drawn(mass: Floats, generator: np.random.Generator) -> int:
    cumulated = np.cumsum(mass)
    return min(int(np.searchsorted(cumulated, generator.random() * cumulated[-1])), mass.size - 1)


def _open_mass(
    space: HypothesisSpace, belief: Belief, dynamics: Floats, generator: np.random.Generator | None = None
) -> tuple[Floats, Floats]:
    """Weight of each class [U, V, W], and of a move being open within it [U, V, W, P, L].

    Args:
        space: the hypotheses.
        belief: the posterior.
        dynamics: float64 [E, C, W], weights.
        generator: None: unknown closed locations are averaged; else they are drawn.
    """
    unknown = closed_probability(belief.closed, belief.obstacle, space.closed)
    if generator is not None:
        unknown = (generator.random(unknown.shape[-1]) < unknown).astype(np.float64)
    num_classes = (len(space.attributes), int(space.capability_class.max()) + 1)
    total = np.zeros((*num_classes, len(space.slips)))
    is_open = np.zeros((*total.shape, *space.space.target.shape))
    kinds = family(space, belief)
    classes = space.attribute_class[belief.environments]
    for u in range(num_classes[0]):
        for v in range(num_classes[1]):
            mine = (classes == u)[:, np.newaxis] & (space.capability_class == v)
            for kind in (KNOWN, OBSTACLES, NO_ENTRY, BOTH):
                part = np.where((mine & (kinds == kind))[..., np.newaxis], dynamics, 0.0)
                if not part.any():
                    continue
                total[u, v] += part.sum(axis=(0, 1))
                is_open[u, v] += known_open(space, belief, part) * (
                    1 - _at_targets(space, unknown[kind, u, v])
                )
    return total, is_open * (space.space.target >= 0)


def _at_targets(space: HypothesisSpace, of_locations: Floats) -> Floats:
    """[..., P, L] from [..., P]."""
    return of_locations[..., space.space.target]


def known_open(space: HypothesisSpace, belief: Belief, part: Floats) -> Floats:
    """float64 [W, P, L]: the weight of hypotheses that know of nothing that closes a move."""
    rows = part.any(axis=(1, 2))
    columns = part.any(axis=(0, 2))
    part, environments = part[rows][:, columns], belief.environments[rows]
    free = (~space.blocked[environments]).astype(np.float64)
    allowed = (~space.no_entry[columns]).astype(np.float64)
    if space.blocked_edges is None:
        mass = np.tensordot(part, free, (0, 0))  # [C, W, P]
        return _at_targets(space, (mass * allowed[:, np.newaxis]).sum(axis=0))
    usable = _at_targets(space, free) * ~space.blocked_edges[environments]
    mass = np.tensordot(part, usable, (0, 0))  # [C, W, P, L]
    known: Floats = (mass * _at_targets(space, allowed)[:, np.newaxis]).sum(axis=0)
    return known


def _model(space: HypothesisSpace, total: Floats, is_open: Floats, objective: Floats) -> DomainModel:
    prob, enabled = _transitions(space, total, is_open)
    target = np.repeat(np.arange(space.num_states)[:, np.newaxis], prob.shape[2], axis=1)
    target = np.repeat(target[np.newaxis], len(prob), axis=0)
    for number, table in enumerate(space.actions):
        target[number, :, : table.target.shape[1]] = table.target
    left = np.flatnonzero(objective)
    by_class = total.sum(axis=(1, 2))
    reward = np.tensordot(by_class, np.tensordot(objective[left], space.reward[:, left], (0, 1)), 1)
    ends = np.tensordot(by_class, np.tensordot(objective[left], space.ends[:, left], (0, 1)), 1)
    going = np.where(ends > 1 - CERTAIN, 0.0, 1 - ends)
    return DomainModel(target, prob, enabled, reward, going)


def _transitions(space: HypothesisSpace, total: Floats, is_open: Floats) -> tuple[Floats, Bools]:
    """Probabilities [A, S, K] and what is possible [A, S]."""
    num_slots = max(table.target.shape[1] for table in space.actions)
    prob = np.zeros((len(space.actions), space.num_states, num_slots))
    kinds = np.flatnonzero(total.sum(axis=(0, 1)) > CERTAIN)
    total, is_open = total[:, :, kinds], is_open[:, :, kinds]
    share = is_open / np.maximum(total, 1e-300)[..., np.newaxis, np.newaxis]
    for number, table in enumerate(space.actions):
        prob[number, :, : table.target.shape[1]] = _mean_slots(space, table, total, share, kinds)
    possible = prob.sum(axis=2)
    prob[:, :, 0] += np.maximum(1 - possible, 0)
    return prob, possible > POSSIBLE


def _mean_slots(
    space: HypothesisSpace, table: ActionTable, total: Floats, share: Floats, kinds: Ints
) -> Floats:
    """float64 [S, K], from the share of open moves [U, V, W, P, L] under some kinds of outcomes."""
    pattern = total[..., np.newaxis, np.newaxis] * np.ones((share.shape[3], 1))  # [U, V, W, P, R]
    for move in table.moves:
        now_open = share[..., move, np.newaxis]
        pattern = np.concatenate([pattern * (1 - now_open), pattern * now_open], axis=-1)
    if space.num_modes > 1:
        pattern = np.repeat(pattern, space.num_modes, axis=3)
    works = pattern * (1 - space.slips[kinds])[:, np.newaxis, np.newaxis]
    slips = np.tensordot(pattern, space.slips[kinds], (2, 0))  # [U, V, S, R]
    slots: Floats = np.einsum("uvwsr,uvwsrk->sk", works, table.prob[:, :, space.disturbance[kinds]])
    slots[:, 0] += (slips * table.enabled).sum(axis=(0, 1, 3))
    return slots


def tabular(space: HypothesisSpace, model: DomainModel, initial: Floats) -> TabularMDP:
    """The model on the states of the belief.

    Args:
        space: the hypotheses.
        model: of the domain.
        initial: float64 [S], where episodes start.

    Raises:
        ModelError: a state that can be reached has no action.
    """
    completed = space.num_states
    action, state, slot = np.nonzero(model.enabled[..., np.newaxis] & (model.prob > 0))
    prob, going = model.prob[action, state, slot], model.continuation[action, state, slot]
    reward = model.reward[action, state, slot]
    names = (*space.case.actions, END_ACTION)
    branches = Branches(
        state=np.concatenate([state, state, [completed]]),
        action=np.concatenate([action, action, [len(names) - 1]]),
        target=np.concatenate(
            [model.target[action, state, slot], np.full(len(state), completed), [completed]]
        ),
        prob=np.concatenate([prob * going, prob * (1 - going), [1.0]]),
        reward=np.concatenate([reward, reward, [0.0]]),
    )
    done = np.zeros(completed + 1, dtype=np.bool_)
    done[completed] = True
    return assemble(
        branches,
        initial=np.append(initial, 0.0),
        labels={COMPLETE_LABEL: done},
        valuations=space.states.valuations,
        variable_names=space.states.variable_names,
        action_names=names,
    )
