"""Streams for the trigger: a policy is carried out on a model it was not made for, or on the one it was.

Axes: T steps of an episode, B episodes side by side, S states, A actions with `end`, M steps of a stream.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from merap.concerns.combination import Combination
from merap.families.index import family_index, index_kinds
from merap.mdp.evaluation import as_policy, expected_return
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.planning import backward_induction, worst_value
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.mdp.simulation import simulator
from merap.strategies.evaluation import executed
from merap.systems.slip import slipping_model
from merap.trigger.readings import Forecast, ObservedSteps
from merap.trigger.settings import ChangeSettings

# float64 [M] of noise on rewards, from a generator and M.
Noise = Callable[[np.random.Generator, int], Floats]
EQUAL = 1e-9


@dataclass(frozen=True, eq=False)
class Known:
    """A model that is known, and its best policy.

    Attributes:
        model: canonical, with slip.
        policy: float64 [T, S, A - 1], the best time-indexed one, over declared actions.
        horizon: T.
        value: of an episode.
    """

    model: TabularMDP
    policy: Floats
    horizon: int
    value: float

    def forecast(self, settings: ChangeSettings) -> Forecast:
        """Return the model's forecast of its policy."""
        return Forecast(self.model, executed(self.model, self.policy), self.horizon, settings)


@dataclass(frozen=True)
class Effect:
    """What a change does to the policy that is carried out.

    Attributes:
        visited: the policy, on the known model, reaches a step whose outcomes or rewards are others now.
        loss: value on the known model less value on the real one, as a part of the former; where that is 0,
            of what it is better by than the worst policy.
    """

    visited: bool
    loss: float


def placed(combination: Combination, slip: float) -> TabularMDP:
    """Return a combination that slips, on the index of locations and modes with one completed state."""
    whole = slipping_model(combination, slip)
    alike = replace(whole, labels={COMPLETE_LABEL: whole.labels[COMPLETE_LABEL]})
    return family_index(index_kinds([combination.program]), combination.actions, [alike]).place(alike)


def known(combination: Combination, slip: float) -> Known:
    """Return a combination that slips, and the best policy for it."""
    model, horizon = placed(combination, slip), combination.objective.horizon
    plan = backward_induction(model, horizon)
    return Known(model, as_policy(model, plan.actions)[..., :-1], horizon, plan.value)


def effect(before: Known, real: TabularMDP) -> Effect:
    """Return the effect on the policy of `real` in place of the known model."""
    value = expected_return(real, executed(real, before.policy), before.horizon)
    return Effect(_visited(before, real), (before.value - value) / _at_stake(before))


def _at_stake(before: Known) -> float:
    """Return the range that losses are a part of; 1 where no policy earns or loses anything."""
    if abs(before.value) > EQUAL:
        return abs(before.value)
    spread = before.value - worst_value(before.model, before.horizon)
    return spread if spread > EQUAL else 1.0


def _visited(before: Known, real: TabularMDP) -> bool:
    policy = executed(before.model, before.policy)
    here = before.model.initial > 0
    for t in range(before.horizon):
        state, action = np.nonzero(policy[t] * here[:, np.newaxis])
        if _differ(before.model, real, state, action):
            return True
        rows = before.model.transitions[before.model.choice_table[state, action]]
        here = np.asarray(rows.sum(axis=0)).ravel() > 0
    return False


def _differ(one: TabularMDP, other: TabularMDP, state: Ints, action: Ints) -> bool:
    first, second = one.choice_table[state, action], other.choice_table[state, action]
    if (second < 0).any():
        return True
    apart = abs(one.transitions[first] - other.transitions[second]).max()
    paid = np.abs(one.choice_reward[first] - other.choice_reward[second]).max()
    return bool(apart > EQUAL or paid > EQUAL)


def stream(
    before: Known, real: TabularMDP, episodes: int, noise: Noise, generator: np.random.Generator
) -> ObservedSteps:
    """Draw episodes of the known model's policy on the real one, one after the other.

    Args:
        before: whose policy is carried out.
        real: what is there, canonical.
        episodes: B.
        noise: on the rewards.
        generator: of all draws.
    """
    drawn = simulator([real])
    # [T, S, A - 1]: the simulator has no `end`
    chances = np.cumsum(executed(real, before.policy)[..., :-1], axis=-1)
    state = drawn.first_states(0, generator.random(episodes))
    state = np.broadcast_to(state, (episodes,)).copy()
    seen = {
        name: np.zeros((episodes, before.horizon), dtype=np.int64) for name in ("state", "action", "target")
    }
    reward = np.zeros((episodes, before.horizon))
    going = np.zeros((episodes, before.horizon), dtype=np.bool_)
    for t in range(before.horizon):
        alive = np.flatnonzero(~drawn.completed[state])
        if not len(alive):
            break
        here = state[alive]
        # A draw of exactly the last sum, up to rounding, still takes the last action that is possible.
        uniform = generator.random(len(alive)) * chances[t, here, -1]
        action = (chances[t, here] <= uniform[:, np.newaxis]).sum(axis=1)
        branch = drawn.successors.draw(drawn.choice[here, action], generator.random(len(alive)))
        state[alive] = drawn.target[branch]
        going[alive, t] = True
        reward[alive, t] = drawn.reward[branch]
        for name, values in (("state", here), ("action", action), ("target", state[alive])):
            seen[name][alive, t] = values
    last = going & ~np.pad(going[:, 1:], ((0, 0), (0, 1)))
    return _flat(seen, reward, last, going, noise, generator)


def _flat(
    seen: dict[str, Ints],
    reward: Floats,
    last: Bools,
    going: Bools,
    noise: Noise,
    generator: np.random.Generator,
) -> ObservedSteps:
    time = np.broadcast_to(np.arange(going.shape[1]), going.shape)[going]
    return ObservedSteps(
        time=time,
        state=seen["state"][going],
        action=seen["action"][going],
        target=seen["target"][going],
        reward=reward[going] + noise(generator, len(time)),
        last=last[going],
    )


def gaussian(deviation: float) -> Noise:
    """Return a source of noise of that standard deviation."""
    return lambda generator, count: deviation * generator.standard_normal(count)
