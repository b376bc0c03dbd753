"""The analyzer's model of the real domain: the mean of a belief, or a sample of it.

Axes as in `belief_space`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.mdp.assembly import Branches, assemble
from merap.mdp.canonical import COMPLETE_LABEL, END_ACTION
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.online.belief import Belief, weights
from merap.online.belief_actions import ActionTable
from merap.online.belief_cells import BOTH, KNOWN, NO_ENTRY, OBSTACLES, closed_probability
from merap.online.belief_space import HypothesisSpace
from merap.online.belief_update import family

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
    total, is_open = _open_mass(space, belief, dynamics)
    return _model(space, total, is_open, objective.sum(axis=1))


def optimistic_model(space: HypothesisSpace, belief: Belief, doubt: float) -> DomainModel:
    """The mean, with every move open that is open with a probability of at least `doubt`."""
    dynamics, objective = weights(belief)
    total, is_open = _open_mass(space, belief, dynamics)
    everywhere = total.sum()
    share = is_open.sum(axis=(0, 1, 2)) / everywhere
    hoped = np.where(share >= doubt, total[..., np.newaxis, np.newaxis], is_open)
    return _model(space, total, hoped, objective.sum(axis=1))


def sampled_model(space: HypothesisSpace, belief: Belief, generator: np.random.Generator) -> DomainModel:
    """A hypothesis drawn from the posterior (Thompson sampling)."""
    dynamics, objective = weights(belief)
    picked = np.zeros_like(dynamics)
    picked.flat[_drawn(dynamics, generator)] = 1.0
    goal = np.zeros(len(objective))
    goal[_drawn(objective.sum(axis=1), generator)] = 1.0
    total, is_open = _open_mass(space, belief, picked, generator)
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
                is_open[u, v] += _known_open(space, belief, part) * (
                    1 - _at_targets(space, unknown[kind, u, v])
                )
    return total, is_open * (space.space.target >= 0)


def _at_targets(space: HypothesisSpace, of_locations: Floats) -> Floats:
    """[..., P, L] from [..., P]."""
    return of_locations[..., space.space.target]


def _known_open(space: HypothesisSpace, belief: Belief, part: Floats) -> Floats:
    """float64 [W, P, L]: the weight of hypotheses that know of nothing that closes a move."""
    rows = part.any(axis=(1, 2))
    columns = part.any(axis=(0, 2))
    part, environments = part[rows][:, columns], belief.environments[rows]
    free = (~space.blocked[environments]).astype(np.float64)
    allowed = (~space.no_entry[columns]).astype(np.float64)
    if space.blocked_edges is None:
        mass = np.einsum("ecw,ep->cwp", part, free, optimize=True)
        return _at_targets(space, np.einsum("cwp,cp->wp", mass, allowed, optimize=True))
    usable = _at_targets(space, free) * ~space.blocked_edges[environments]
    mass = np.einsum("ecw,epl->cwpl", part, usable, optimize=True)
    return np.asarray(np.einsum("cwpl,cpl->wpl", mass, _at_targets(space, allowed), optimize=True))


def _model(space: HypothesisSpace, total: Floats, is_open: Floats, objective: Floats) -> DomainModel:
    num_actions, num_states, num_slots = space.reward.shape[2:]
    target = np.repeat(np.arange(num_states)[np.newaxis, :, np.newaxis], num_actions, axis=0)
    target = np.repeat(target, num_slots, axis=2)
    prob = np.zeros(target.shape)
    enabled = np.zeros(target.shape[:2], dtype=np.bool_)
    for number, table in enumerate(space.actions):
        width = table.target.shape[1]
        target[number, :, :width] = table.target
        prob[number, :, :width] = _mean_slots(space, table, total, is_open)
        possible = prob[number].sum(axis=1)
        enabled[number] = possible > POSSIBLE
        prob[number, :, 0] += 1 - possible
    by_class = total.sum(axis=(1, 2))
    reward = np.tensordot(np.tensordot(by_class, space.reward, 1), objective, (0, 0))
    ends = np.tensordot(np.tensordot(by_class, space.ends, 1), objective, (0, 0))
    going = np.where(ends > 1 - CERTAIN, 0.0, 1 - ends)
    return DomainModel(target, prob, enabled, reward, going)


def _mean_slots(space: HypothesisSpace, table: ActionTable, total: Floats, is_open: Floats) -> Floats:
    """float64 [S, K]."""
    share = is_open[..., list(table.moves)] / np.maximum(total, 1e-300)[..., np.newaxis, np.newaxis]
    pattern = total[..., np.newaxis, np.newaxis] * np.ones((is_open.shape[3], 1))  # [U, V, W, P, R]
    for bit in range(len(table.moves)):
        now_open = share[..., bit, np.newaxis]
        pattern = np.concatenate([pattern * (1 - now_open), pattern * now_open], axis=-1)
    pattern = np.repeat(pattern, space.num_modes, axis=3)
    done = np.einsum("uvwsr,w,uvsrk->sk", pattern, 1 - space.slips, table.prob, optimize=True)
    done[:, 0] += np.einsum("uvwsr,w,vsr->s", pattern, space.slips, table.enabled * 1.0, optimize=True)
    return np.asarray(done)


def tabular(space: HypothesisSpace, model: DomainModel, initial: Floats) -> TabularMDP:
    """The model on the canonical index.

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
        valuations=space.valuations,
        variable_names=space.variable_names,
        action_names=names,
    )
