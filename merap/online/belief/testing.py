"""When it pays to try a way that is believed to be closed, or slow.

A plan on the mean never looks again at what it holds improbable, however much there is to gain and
however often it will act. So the mean is compared with a hope: the same model with every doubtful
move open. The hope is tried if it would pay over the episodes ahead.

Axes as in `space`; T steps that remain.
"""

from __future__ import annotations

from dataclasses import dataclass

from merap.online.belief.model import DomainModel
from merap.online.belief.planning import Plan

SURE = 1 - 1e-6


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


def trial(mean: DomainModel, best: Plan, hoped: DomainModel, hope: Plan, state: int) -> Trial:
    """Follow the likeliest path of the hope from a state, and turn back where it fails.

    Args:
        mean: the belief's mean model.
        best: the plan on it.
        hoped: the model of the hope.
        hope: the plan on that, over as many steps.
        state: where the system is.
    """
    usual = float(best.values[0, state])
    gain = float(hope.values[0, state]) - usual
    chance, price, spent, here = 1.0, 0.0, 0.0, state
    if gain <= 0:
        return Trial(chance, 0.0, 0.0)
    for t, actions in enumerate(hope.actions):
        action = int(actions[here])
        slot = int(hoped.prob[action, here].argmax())
        spent += float(hoped.prob[action, here] @ hoped.reward[action, here])
        exists = float(mean.prob[action, here, slot] / hoped.prob[action, here, slot])
        if exists < SURE:
            price += chance * (1 - exists) * (usual - spent - float(best.values[t + 1, here]))
            chance *= exists
        if hoped.continuation[action, here, slot] < 0.5:
            break
        here = int(hoped.target[action, here, slot])
    return Trial(chance, gain, max(price, 0.0))
