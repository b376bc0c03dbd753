"""Optimistic exploration: when it pays to try a way that the belief holds closed, or slow.

A plan on the mean model never looks again at what the belief holds improbable, however much there is to gain
and however many episodes lie ahead. So the plan on the mean is compared with an optimistic plan: the best
plan on the same model with every doubtful move open. The optimistic plan is tried if it would pay over the
episodes ahead.

The optimistic plan ignores the probability of its path. Where it does not pay, a likelier path with less to
gain, or as much, may: paths differ in their gain and in the log of their chance, and the sum of a path's
log-probabilities can be planned with as rewards are. So the next optimistic plan puts a price on
improbability at which the last one is worth no more than the plan on the mean (the secant step of a search
over two objectives).

Axes as in `space`; T steps that remain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from merap.belief.model import DomainModel
from merap.belief.planning import FinitePlan, plan
from merap.mdp.model import Floats

SURE = 1 - 1e-6
# The slot of an action that leads nowhere, as a move that is closed does.
STAY = 0
# Of two optimistic plans that are equally good the likelier is taken: a price of improbability that decides
# nothing else, in units of the range of rewards.
SLIGHT = 1e-6


@dataclass(frozen=True)
class OptimisticOutcome:
    """The outcome to expect from following an optimistic plan once.

    Attributes:
        chance: probability that its path exists.
        gain: additional return of an episode if the path exists.
        price: expected loss of this episode if the path does not exist.
    """

    chance: float
    gain: float
    price: float

    def pays(self, episodes: float) -> bool:
        """Return whether following the plan pays over that many episodes."""
        return self.chance * self.gain * episodes > self.price


def optimistic_plans(
    mean: DomainModel, best: FinitePlan, optimistic: DomainModel, state: int, ties: Floats
) -> Iterator[tuple[OptimisticOutcome, FinitePlan]]:
    """Yield ever likelier optimistic plans with ever less to gain; the first has the most to gain.

    Args:
        mean: the belief's mean model.
        best: the plan on it.
        optimistic: the same model with every doubtful move open.
        state: where the system is.
        ties: float64 [A, S], tiny preferences among actions that are equally good.
    """
    chances = np.log(_exists(mean, optimistic))
    price, chance = SLIGHT * (float(np.ptp(optimistic.reward)) or 1.0), 0.0
    while True:
        daring = plan(optimistic, len(best.actions), price * chances, ties)
        found = _expected_outcome(mean, best, optimistic, daring, state)
        if found.gain <= 0 or found.chance <= chance:
            return
        yield found, daring
        if found.chance > SURE:
            return
        chance = found.chance
        price = found.gain / -np.log(chance)


def _expected_outcome(
    mean: DomainModel, best: FinitePlan, optimistic: DomainModel, daring: FinitePlan, state: int
) -> OptimisticOutcome:
    """Follow the likeliest path of an optimistic plan from a state, and turn back where it fails.

    Args:
        mean: the belief's mean model.
        best: the plan on it.
        optimistic: the same model with every doubtful move open.
        daring: a plan on the optimistic model, over as many steps.
        state: where the system is.
    """
    usual = float(best.values[0, state])
    gain = _worth(optimistic, daring, state) - usual
    chance, price, spent, here = 1.0, 0.0, 0.0, state
    if gain <= 0:
        return OptimisticOutcome(chance, 0.0, 0.0)
    for t, actions in enumerate(daring.actions):
        action = int(actions[here])
        slot = int(optimistic.prob[action, here].argmax())
        exists = float(mean.prob[action, here, slot] / optimistic.prob[action, here, slot])
        if exists < SURE:
            back = spent + float(mean.reward[action, here, STAY]) + float(best.values[t + 1, here])
            price += chance * (1 - exists) * (usual - back)
            chance *= exists
        spent += float(optimistic.prob[action, here] @ optimistic.reward[action, here])
        if optimistic.continuation[action, here, slot] < 0.5:
            break
        here = int(optimistic.target[action, here, slot])
    return OptimisticOutcome(chance, gain, max(price, 0.0))


def _exists(mean: DomainModel, optimistic: DomainModel) -> Floats:
    """float64 [A, S], the probability that each action's likeliest optimistic outcome is possible."""
    slot = optimistic.prob.argmax(axis=2)[..., np.newaxis]
    hopeful = np.take_along_axis(optimistic.prob, slot, axis=2)[..., 0]
    actual = np.take_along_axis(mean.prob, slot, axis=2)[..., 0]
    return np.clip(actual / np.where(hopeful > 0, hopeful, 1.0), np.finfo(float).tiny, 1.0)


def _worth(model: DomainModel, chosen: FinitePlan, state: int) -> float:
    """Return what a plan earns on a model from a state on, whatever model it was made for."""
    states = np.arange(model.enabled.shape[1])
    expected = np.einsum("ask,ask->as", model.prob, model.reward)
    onward = model.prob * model.continuation
    values = np.zeros(len(states))
    for actions in chosen.actions[::-1]:
        of_action = expected[actions, states]
        values = of_action + (onward[actions, states] * values[model.target[actions, states]]).sum(axis=1)
    return float(values[state])
