"""A belief in plain lines: which hypotheses are left, with what weight, and what is suspected outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.mdp.model import Floats
from merap.online.belief.cells import closed_probability
from merap.online.belief.posterior import Belief, concern_weights, weights
from merap.online.belief.space import HypothesisSpace
from merap.online.belief.update import family

SHOWN = 3
LEFT = 1e-3
SUSPECTED = 0.5


@dataclass(frozen=True)
class DynamicsClass:
    """Environments and capabilities that no observation of the system can tell apart.

    Attributes:
        weight: of all of them together.
        members: `<environment>.<capability>`, the heaviest first.
    """

    weight: float
    members: tuple[str, ...]


@dataclass(frozen=True)
class Summary:
    """A belief in numbers.

    Attributes:
        environment: the heaviest configurations with their weights; likewise the others.
        capability: likewise.
        objective: likewise.
        left: how many of each are left, by a weight above 0.001.
        outside: environment, capability, objective, slip -> weight outside the base.
        closed: locations suspected to be closed in a way no configuration says.
        slip: expected probability that an action does nothing.
        noise: expected standard deviation of the noise on rewards.
        classes: the heaviest observational equivalence classes of the dynamics.
    """

    environment: tuple[tuple[str, float], ...]
    capability: tuple[tuple[str, float], ...]
    objective: tuple[tuple[str, float], ...]
    left: dict[str, int]
    outside: dict[str, float]
    closed: tuple[tuple[str, float], ...]
    slip: float
    noise: float
    classes: tuple[DynamicsClass, ...]


def summarise(space: HypothesisSpace, belief: Belief) -> Summary:
    """The belief in numbers."""
    environment, capability, objective = concern_weights(space, belief)
    dynamics, noisy = weights(belief)
    slips = dynamics.sum(axis=(0, 1))
    num_capabilities = len(capability) - int(space.capability_class[-1]) - 1
    return Summary(
        environment=_heaviest(space.environment_names, environment),
        capability=_heaviest(space.capability_names, capability),
        objective=_heaviest(space.objective_names, objective),
        left={
            "environment": int(np.count_nonzero(environment > LEFT)),
            "capability": int(np.count_nonzero(capability > LEFT)),
            "objective": int(np.count_nonzero(objective > LEFT)),
        },
        outside={
            "environment": float(environment[-1]),
            "capability": float(capability[num_capabilities:].sum()),
            "objective": float(objective[space.num_objectives :].sum()),
            "slip": float(slips[1:].sum()),
        },
        closed=_suspected(space, belief, dynamics),
        slip=float(slips @ space.slips),
        noise=float(noisy.sum(axis=0)[1:] @ space.noises[1:])
        if len(space.noises) > 1
        else float(space.noises[0]),
        classes=equivalence_classes(space, belief),
    )


def _heaviest(names: Sequence[str], mass: Floats) -> tuple[tuple[str, float], ...]:
    return tuple((names[index], float(mass[index])) for index in np.argsort(-mass, kind="stable")[:SHOWN])


def _suspected(space: HypothesisSpace, belief: Belief, dynamics: Floats) -> tuple[tuple[str, float], ...]:
    unknown = closed_probability(belief.closed, belief.obstacle, space.closed)
    attributes = space.attribute_class[belief.environments]
    kinds = family(space, belief)
    mass = np.zeros(unknown.shape[:-1])
    index = (kinds, attributes[:, np.newaxis], space.capability_class[np.newaxis])
    np.add.at(mass, index, dynamics)
    closed = np.einsum("fuvw,fuvwp->p", mass, unknown)
    return tuple(
        (space.space.locations[place], float(closed[place]))
        for place in np.argsort(-closed, kind="stable")
        if closed[place] > SUSPECTED
    )


def equivalence_classes(space: HypothesisSpace, belief: Belief) -> tuple[DynamicsClass, ...]:
    """The heaviest classes of (environment, capability) with equal moves and outcomes.

    An obstacle and a location that may not be entered act alike; a detector of obstacles tells
    them apart, and then they are no class.
    """
    dynamics, _ = weights(belief)
    mass = dynamics.sum(axis=2)
    leading = [divmod(int(flat), mass.shape[1]) for flat in np.argsort(-mass, axis=None)[:100]]
    groups: dict[object, list[tuple[str, float]]] = {}
    for row, column in leading:
        if mass[row, column] > LEFT:
            name = f"{space.environment_names[belief.environments[row]]}.{space.capability_names[column]}"
            groups.setdefault(_appearance(space, belief, row, column), []).append(
                (name, float(mass[row, column]))
            )
    classes = [
        DynamicsClass(sum(w for _, w in group), tuple(name for name, _ in group)) for group in groups.values()
    ]
    return tuple(sorted(classes, key=lambda one: -one.weight)[:SHOWN])


def _appearance(space: HypothesisSpace, belief: Belief, row: int, column: int) -> object:
    """Equal for hypotheses that act alike."""
    environment = belief.environments[row]
    blocked, no_entry = space.blocked[environment], space.no_entry[column]
    seen = blocked.tobytes() if any(one.of == "blocked" for one in space.space.detectors) else b""
    edges = b"" if space.blocked_edges is None else space.blocked_edges[environment].tobytes()
    unknown = bool(family(space, belief)[row, column])
    classes = (int(space.attribute_class[environment]), int(space.capability_class[column]))
    return (blocked | no_entry).tobytes(), edges, seen, unknown, classes


def explain(space: HypothesisSpace, belief: Belief, reason: str) -> tuple[str, str]:
    """What is left, and what is suspected outside the base."""
    found = summarise(space, belief)
    concerns = "; ".join(
        f"{concern} {_listed(getattr(found, concern))} ({found.left[concern]} left)"
        for concern in ("objective", "environment", "capability")
    )
    outside = ", ".join(f"{kind} {mass:.2g}" for kind, mass in found.outside.items())
    closed = ", ".join(f"{name} {mass:.2f}" for name, mass in found.closed) or "none"
    alike = next((one for one in found.classes if len(one.members) > 1), None)
    same = f"; not distinguishable: {' = '.join(alike.members[:SHOWN])}" if alike else ""
    unexplained = f"; {belief.unexplained} observations unexplained" if belief.unexplained else ""
    return (
        f"{reason}; {concerns}",
        f"outside the base: {outside}; closed: {closed}; slip {found.slip:.2f}; noise {found.noise:.2g}"
        f"{same}{unexplained}",
    )


def _listed(pairs: Sequence[tuple[str, float]]) -> str:
    return ", ".join(f"{name} {mass:.2f}" for name, mass in pairs if mass >= 0.01)
