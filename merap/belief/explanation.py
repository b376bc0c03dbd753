"""A belief in plain lines: which hypotheses are left, with what weight, and what is suspected outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from merap.belief.cells import closed_probability
from merap.belief.equivalence import EquivalenceClass, Indistinct, alike_for_good, alike_so_far
from merap.belief.posterior import Belief, concern_weights, weights
from merap.belief.space import HypothesisSpace
from merap.belief.update import family
from merap.mdp.model import Floats

SHOWN = 3
LEFT = 1e-3
SUSPECTED = 0.5
# Weights below are not worth a word.
SHARE = 0.01
NOTHING = 1e-6


@dataclass(frozen=True)
class Summary:
    """A belief in numbers.

    Attributes:
        environment: the heaviest configurations with their weights; likewise the others.
        capability: likewise.
        objective: likewise.
        left: how many of each are left, by a weight above 0.001.
        outside: environment, capability, objective, slip, outcomes -> weight outside the base.
        closed: locations suspected to be closed in a way no configuration says.
        slip: expected probability that an action does nothing.
        noise: expected standard deviation of the noise on rewards.
        outcomes: the heaviest kinds of outcomes (as the base says, a slip, other odds).
        alike_so_far: the heaviest classes of hypotheses that nothing seen so far tells apart.
        alike_for_good: the heaviest classes that no observation can ever tell apart.
    """

    environment: tuple[tuple[str, float], ...]
    capability: tuple[tuple[str, float], ...]
    objective: tuple[tuple[str, float], ...]
    left: dict[str, int]
    outside: dict[str, float]
    closed: tuple[tuple[str, float], ...]
    slip: float
    noise: float
    outcomes: tuple[tuple[str, float], ...]
    alike_so_far: Indistinct
    alike_for_good: Indistinct


def summarise(space: HypothesisSpace, belief: Belief) -> Summary:
    """The belief in numbers."""
    environment, capability, objective = concern_weights(space, belief)
    dynamics, noisy = weights(belief)
    kinds = dynamics.sum(axis=(0, 1))
    slipping = space.slips > 0
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
            "slip": float(kinds[slipping].sum()),
            "outcomes": float(kinds[1:].sum() - kinds[slipping].sum()),
        },
        closed=_suspected(space, belief, dynamics),
        slip=float(kinds @ space.slips),
        noise=float(noisy.sum(axis=0)[1:] @ space.noises[1:])
        if len(space.noises) > 1
        else float(space.noises[0]),
        outcomes=_heaviest(space.outcome_names, kinds),
        alike_so_far=alike_so_far(space, belief, SHOWN),
        alike_for_good=alike_for_good(space, belief, SHOWN),
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


def explain(space: HypothesisSpace, belief: Belief, reason: str) -> tuple[str, ...]:
    """What is left, what is suspected outside the base, and what cannot be told apart."""
    found = summarise(space, belief)
    concerns = "; ".join(
        f"{concern} {_listed(getattr(found, concern))} ({found.left[concern]} left)"
        for concern in ("objective", "environment", "capability")
    )
    outside = ", ".join(f"{kind} {_figure(mass)}" for kind, mass in found.outside.items())
    closed = ", ".join(f"{name} {mass:.2f}" for name, mass in found.closed) or "none"
    unexplained = f"; {belief.unexplained} observations unexplained" if belief.unexplained else ""
    return (
        f"{reason}; {concerns}",
        f"outside the base: {outside}; closed: {closed}; outcomes: {_listed(found.outcomes)}; "
        f"noise {_figure(found.noise)}{unexplained}",
        f"not told apart so far: {_indistinct(found.alike_so_far)}",
        f"never to be told apart: {_indistinct(found.alike_for_good)}",
    )


def _figure(value: float) -> str:
    """Return a weight or a deviation with two digits; 0 where it is next to nothing."""
    return "0" if value < NOTHING else f"{value:.2g}"


def _indistinct(alike: Indistinct) -> str:
    classes = [one for one in (*alike.dynamics, *alike.objective) if one.size > 1 and one.weight >= SHARE]
    return "; ".join(_described(one) for one in classes) or "nothing"


def _described(alike: EquivalenceClass) -> str:
    more = ", .." if alike.size > SHOWN else ""
    return f"{alike.size} with weight {alike.weight:.2f} ({', '.join(alike.members[:SHOWN])}{more})"


def _listed(pairs: Sequence[tuple[str, float]]) -> str:
    return ", ".join(f"{name} {mass:.2f}" for name, mass in pairs if mass >= SHARE)
