"""Hypotheses that observations cannot tell apart: none so far, or none ever.

*So far* is read off the belief: every observation was equally likely under hypotheses whose posterior
odds are still their prior odds. *For good* is read off the hypotheses: what can be reached, done, seen and
earned is the same under all of a class. An obstacle and a location that may not be entered act alike;
a detector of obstacles that can come near tells them apart.

Axes as in `space`; X edges, H bytes with a bit for each pair of environment and capability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merap.belief.posterior import Belief, weights
from merap.belief.space import HypothesisSpace
from merap.belief.update import family
from merap.mdp.model import Bools, Floats, Ints

Packed = npt.NDArray[np.uint8]

# Members of a class that are listed, of all that it counts.
LISTED = 10
# Log-likelihoods that differ by less are equal.
RESOLUTION = 1e-6
NEGLIGIBLE = 1e-12


@dataclass(frozen=True)
class EquivalenceClass:
    """Hypotheses that cannot be told apart.

    Attributes:
        weight: of all of them together.
        size: how many they are.
        members: names of the heaviest.
    """

    weight: float
    size: int
    members: tuple[str, ...]


@dataclass(frozen=True)
class Indistinct:
    """Equivalence classes, the heaviest first.

    Attributes:
        dynamics: of `<environment>.<capability>`.
        objective: of objectives.
    """

    dynamics: tuple[EquivalenceClass, ...]
    objective: tuple[EquivalenceClass, ...]


def alike_so_far(space: HypothesisSpace, belief: Belief, count: int) -> Indistinct:
    """The `count` heaviest classes of hypotheses under which everything seen so far was equally likely."""
    dynamics, objective = (mass.sum(axis=-1) for mass in weights(belief))
    prior = np.exp(space.prior[belief.environments]).sum(axis=2)
    return Indistinct(
        _classes(_levels(dynamics, prior).ravel(), dynamics.ravel(), _PairNames(space, belief), count),
        _classes(_levels(objective, np.exp(space.objective_prior)), objective, space.objective_names, count),
    )


def alike_for_good(space: HypothesisSpace, belief: Belief, count: int) -> Indistinct:
    """The `count` heaviest classes of hypotheses that no observation can ever tell apart.

    Hypotheses with unknown closed locations count as alike if they agree on the known ones: each of
    them leaves room for the same. A detector of obstacles tells unknown obstacles from the others.
    """
    dynamics, objective = (mass.sum(axis=-1) for mass in weights(belief))
    return Indistinct(
        _classes(_dynamics_keys(space, belief).ravel(), dynamics.ravel(), _PairNames(space, belief), count),
        _classes(_objective_keys(space, belief), objective, space.objective_names, count),
    )


@dataclass(frozen=True, eq=False)
class _PairNames:
    """`<environment>.<capability>` by the number of a pair in play."""

    space: HypothesisSpace
    belief: Belief

    def __getitem__(self, number: int) -> str:
        row, column = divmod(int(number), len(self.space.capability_names))
        environment = self.space.environment_names[self.belief.environments[row]]
        return f"{environment}.{self.space.capability_names[column]}"


def _levels(posterior: Floats, prior: Floats) -> Ints:
    """The likelihood of everything seen, as a number that is equal for equal ones."""
    ratio = np.log(np.maximum(posterior, 1e-300)) - np.log(prior)
    return np.round(ratio / RESOLUTION).astype(np.int64)


def _classes(
    keys: Ints, mass: Floats, names: Sequence[str] | _PairNames, count: int
) -> tuple[EquivalenceClass, ...]:
    """The heaviest classes of equal keys; what has no weight left is in none."""
    left = np.flatnonzero(mass > NEGLIGIBLE)
    left = left[np.argsort(-mass[left], kind="stable")]
    _, number = np.unique(keys[left], return_inverse=True)
    total = np.bincount(number, mass[left])
    return tuple(
        EquivalenceClass(
            float(total[group]),
            int(np.count_nonzero(number == group)),
            tuple(names[member] for member in left[number == group][:LISTED]),
        )
        for group in np.argsort(-total, kind="stable")[:count]
    )


def _dynamics_keys(space: HypothesisSpace, belief: Belief) -> Ints:
    """int64 [E, C], equal for hypotheses that are alike for good."""
    rows = belief.environments
    closed = space.blocked[rows][:, np.newaxis] | space.no_entry
    shape = closed.shape[:2]
    edges = _edges(space)
    reached = _reached(space, belief, edges)
    features = [
        _packed(closed) & (reached | edges.ahead(reached)),
        *_seen_obstacles(space, belief, edges, reached),
    ]
    shut = _shut_edges(space, belief, edges)
    if shut is not None:
        features.append(shut & reached[edges.source])
    shown = np.packbits(_unpacked(np.concatenate(features), shape), axis=2)
    attributes, capabilities = _equal_classes(space)
    kinds = family(space, belief)
    classes = np.stack(
        np.broadcast_arrays(
            attributes[space.attribute_class[rows]][:, np.newaxis],
            capabilities[space.capability_class],
            kinds if space.sees_obstacles else kinds > 0,
        ),
        axis=2,
    )
    return _numbered(np.concatenate([shown, classes.astype(np.int64).view(np.uint8)], axis=2))


def _numbered(rows: Packed) -> Ints:
    """int64 [...], equal for equal rows of bytes [..., n]."""
    flat = rows.reshape(-1, rows.shape[-1])
    padded = np.zeros((len(flat), -(-flat.shape[1] // 8) * 8), dtype=np.uint8)
    padded[:, : flat.shape[1]] = flat
    words = padded.view(np.uint64)
    order = np.lexsort(words.T)
    differs = (words[order[1:]] != words[order[:-1]]).any(axis=1)
    numbers = np.empty(len(flat), dtype=np.int64)
    numbers[order] = np.concatenate([[0], np.cumsum(differs)])
    return numbers.reshape(rows.shape[:-1])


def _packed(of_hypotheses: Bools) -> Packed:
    """uint8 [n, H], one bit for each hypothesis, of bool [E, C, n]."""
    return np.packbits(of_hypotheses.reshape(-1, of_hypotheses.shape[2]).T, axis=1)


def _unpacked(packed: Packed, shape: tuple[int, int]) -> Bools:
    """bool [E, C, n], the inverse of `_packed`."""
    bits = np.unpackbits(packed, axis=1, count=shape[0] * shape[1])
    return bits.T.reshape(*shape, len(packed)).astype(np.bool_)


@dataclass(frozen=True, eq=False)
class _Edges:
    """All edges, those to the same location side by side.

    Attributes:
        source: int64 [X], a location.
        move: int64 [X], a label.
        first: int64, where the edges to each of `targets` begin.
        targets: int64, the locations that edges lead to.
        num_locations: P.
    """

    source: Ints
    move: Ints
    first: Ints
    targets: Ints
    num_locations: int

    def ahead(self, places: Packed, shut: Packed | None = None) -> Packed:
        """uint8 [P, H], the locations that an edge leads to from some places [P, H].

        Args:
            places: the places, under every hypothesis.
            shut: uint8 [X, H], edges that cannot be used; None: none is.
        """
        along = places[self.source] if shut is None else places[self.source] & ~shut
        ahead = np.zeros((self.num_locations, places.shape[1]), dtype=np.uint8)
        ahead[self.targets] = np.bitwise_or.reduceat(along, self.first, axis=0)
        return ahead


def _edges(space: HypothesisSpace) -> _Edges:
    source, move = np.nonzero(space.space.target >= 0)
    target = space.space.target[source, move]
    order = np.argsort(target, kind="stable")
    targets, first = np.unique(target[order], return_index=True)
    return _Edges(source[order], move[order], first, targets, space.space.num_locations)


def _shut_edges(space: HypothesisSpace, belief: Belief, edges: _Edges) -> Packed | None:
    """uint8 [X, H], edges that are blocked."""
    if space.blocked_edges is None:
        return None
    shut = space.blocked_edges[belief.environments][:, edges.source, edges.move]
    return _packed(np.repeat(shut[:, np.newaxis], len(space.capability_names), axis=1))


def _reached(space: HypothesisSpace, belief: Belief, edges: _Edges) -> Packed:
    """uint8 [P, H], locations that some moves lead to from the start."""
    is_open = ~_packed(space.blocked[belief.environments][:, np.newaxis] | space.no_entry)
    shut = _shut_edges(space, belief, edges)
    reached = np.zeros_like(is_open)
    reached[space.initial.reshape(-1, space.num_modes).any(axis=1)] = 255
    while True:
        wider = reached | (edges.ahead(reached, shut) & is_open)
        if np.array_equal(wider, reached):
            return wider
        reached = wider


def _seen_obstacles(space: HypothesisSpace, belief: Belief, edges: _Edges, reached: Packed) -> list[Packed]:
    """What a detector of obstacles can show [P, H]; nothing without one."""
    if not space.sees_obstacles:
        return []
    seen = reached
    for _ in range(max(one.range for one in space.space.detectors if one.of == "blocked")):
        seen = seen | edges.ahead(seen)
    blocked = space.blocked[belief.environments][:, np.newaxis]
    return [_packed(np.repeat(blocked, len(space.capability_names), axis=1)) & seen]


def _equal_classes(space: HypothesisSpace) -> tuple[Ints, Ints]:
    """int64 [U] and [V], equal for classes whose tables are equal."""
    detected = {one.of for one in space.space.detectors}
    visible = [number for number, one in enumerate(space.space.attributes) if one.name in detected]
    attributes = [
        (
            *(table.prob[u].tobytes() for table in space.actions),
            space.reward[u].tobytes(),
            space.ends[u].tobytes(),
            space.attributes[u, visible].tobytes(),
        )
        for u in range(len(space.attributes))
    ]
    capabilities = [
        tuple(table.prob[:, v].tobytes() + table.enabled[v].tobytes() for table in space.actions)
        for v in range(int(space.capability_class.max()) + 1)
    ]
    return _numbers(attributes), _numbers(capabilities)


def _numbers(keys: Sequence[object]) -> Ints:
    known = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    return np.array([known[key] for key in keys])


def _objective_keys(space: HypothesisSpace, belief: Belief) -> Ints:
    """int64 [O], equal for objectives that pay and end alike wherever some hypothesis in play can be."""
    dynamics, _ = weights(belief)
    likely = dynamics.sum(axis=2) > NEGLIGIBLE
    reached = _unpacked(_reached(space, belief, _edges(space)), likely.shape)
    everywhere = reached[likely].any(axis=0)
    states = np.repeat(everywhere, space.num_modes)
    keys = [
        space.reward[:, number][:, :, states].tobytes() + space.ends[:, number][:, :, states].tobytes()
        for number in range(len(space.objective_names))
    ]
    return _numbers(keys)
