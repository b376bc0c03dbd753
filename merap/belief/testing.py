"""When it pays to try a way that is believed to be closed, or slow.

A plan on the mean never looks again at what it holds improbable, however much there is to gain and
however often it will act. So the mean is compared with a hope: the same model with every doubtful
move open. The hope is tried if it would pay over the episodes ahead.

A hope alone does not mind how unlikely its way is. Where it does not pay, a likelier way with less to gain,
or as much, may: ways differ in gain and in the log of their chance, and the sum of a way's log-probabilities
can be planned with as rewards are. So the next hope is the plan with a price on improbability at which the
last one is worth no more than the plan on the mean (the secant step of a search over two objectives).

Axes as in `space`; T steps that remain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from merap.belief.model import DomainModel
from merap.belief.planning import Plan, plan
from merap.mdp.model import Floats

SURE = 1 - 1e-6
# The slot of an action that leads nowhere, as a move that is closed does.
STAY = 0
# Of two hopes that are equally good the likelier is taken: a price of improbability that decides nothing
# else, in units of the range of rewards.
SLIGHT = 1e-6


@dataclass(frozen=True)
class Trial:
    """What it means to follow a hope once.

    Attributes:
        chance: that the way it leads exists.
        gain: what an episode earns more if it does.
        price: what this episode is expected to lose if it doesn't.
    """

    chance: float
    gain: float
    price: float

    def pays(self, episodes: float) -> bool:
        """Whether it does over that many episodes."""
        return self.chance * self.gain * episodes > self.price


def hopes(
    mean: DomainModel, best: Plan, hoped: DomainModel, state: int, ties: Floats
) -> Iterator[tuple[Trial, Plan]]:
    """Ever likelier hopes with ever less to gain; the first has the most to gain.

    Args:
        mean: the belief's mean model.
        best: the plan on it.
        hoped: the model of the hope.
        state: where the system is.
        ties: float64 [A, S], tiny preferences among actions that are equally good.
    """
    chances = np.log(_exists(mean, hoped))
    price, chance = SLIGHT * (float(np.ptp(hoped.reward)) or 1.0), 0.0
    while True:
        hope = plan(hoped, len(best.actions), price * chances, ties)
        found = trial(mean, best, hoped, hope, state)
        if found.gain <= 0 or found.chance <= chance:
            return
        yield found, hope
        if found.chance > SURE:
            return
        chance = found.chance
        price = found.gain / -np.log(chance)


def trial(mean: DomainModel, best: Plan, hoped: DomainModel, hope: Plan, state: int) -> Trial:
    """Follow the likeliest path of the hope from a state, and turn back where it fails.

    Args:
        mean: the belief's mean model.
        best: the plan on it.
        hoped: the model of the hope.
        hope: a plan on that, over as many steps.
        state: where the system is.
    """
    usual = float(best.values[0, state])
    gain = _worth(hoped, hope, state) - usual
    chance, price, spent, here = 1.0, 0.0, 0.0, state
    if gain <= 0:
        return Trial(chance, 0.0, 0.0)
    for t, actions in enumerate(hope.actions):
        action = int(actions[here])
        slot = int(hoped.prob[action, here].argmax())
        exists = float(mean.prob[action, here, slot] / hoped.prob[action, here, slot])
        if exists < SURE:
            back = spent + float(mean.reward[action, here, STAY]) + float(best.values[t + 1, here])
            price += chance * (1 - exists) * (usual - back)
            chance *= exists
        spent += float(hoped.prob[action, here] @ hoped.reward[action, here])
        if hoped.continuation[action, here, slot] < 0.5:
            break
        here = int(hoped.target[action, here, slot])
    return Trial(chance, gain, max(price, 0.0))


def _exists(mean: DomainModel, hoped: DomainModel) -> Floats:
    """float64 [A, S], the probability that each action's likeliest outcome under the hope is possible."""
    slot = hoped.prob.argmax(axis=2)[..., np.newaxis]
    hope = np.take_along_axis(hoped.prob, slot, axis=2)[..., 0]
    actual = np.take_along_axis(mean.prob, slot, axis=2)[..., 0]
    return np.clip(actual / np.where(hope > 0, hope, 1.0), np.finfo(float).tiny, 1.0)


def _worth(model: DomainModel, chosen: Plan, state: int) -> float:
    """What a plan earns on a model from a state on, what it was made for aside."""
    states = np.arange(model.enabled.shape[1])
    expected = np.einsum("ask,ask->as", model.prob, model.reward)
    onward = model.prob * model.continuation
    values = np.zeros(len(states))
    for actions in chosen.actions[::-1]:
        of_action = expected[actions, states]
        values = of_action + (onward[actions, states] * values[model.target[actions, states]]).sum(axis=1)
    return float(values[state])
