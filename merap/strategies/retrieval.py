"""The strategy `retrieval`: play the best policy of the model of the base that fits the observations best.

It learns nothing beyond the choice of a case, so it never finds what no case has.

Axes: N cases, T steps, S states, A declared actions, K successors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.families.build import ModelBase
from merap.learning.tasks import TaskBatch, ranges_between
from merap.mdp.model import Bools, Floats, Ints
from merap.strategies.fixed import optimal_policy
from merap.systems.interface import Observation
from merap.systems.strategy import StateIndex, draw_action


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit of a case to a step.

    Attributes:
        reward_deviation: standard deviation of observed rewards about a case's, in units of the
            range of the base's rewards.
        unexplained: log-likelihood of a step that a case can't explain, and of finding
            other actions enabled; none is worth less, so that one odd step refutes no case for good.
    """

    reward_deviation: float = 0.1
    unexplained: float = -10.0


@dataclass(frozen=True)
class _Step:
    state: int
    action: int
    target: int
    reward: float


class RetrievalStrategy:
    """Retrieves a case of the base after every episode; see `systems.strategy.Strategy`.

    Args:
        base: the N cases.
        tasks: the same as arrays.
        horizon: T.
        generator: draws preferences among cases that fit equally well.
        settings: settings of the fit.
    """

    episodes_per_update = 1

    def __init__(
        self,
        base: ModelBase,
        tasks: TaskBatch,
        horizon: int,
        generator: np.random.Generator,
        settings: FitSettings | None = None,
    ) -> None:
        self._names = base.names
        self._models = base.models
        self._horizon = horizon
        self._generator = generator
        self._settings = settings or FitSettings()
        self._number = StateIndex(base.index)
        self._first: Ints = tasks.choice_to_branch.numpy()
        self._target: Ints = tasks.branch_target.numpy()
        self._prob: Floats = tasks.branch_prob.double().numpy()
        self._reward: Floats = tasks.branch_reward.double().numpy()
        self._enabled: Bools = tasks.enabled.numpy()
        possible = self._reward[self._prob > 0]
        scale = float(np.ptp(possible)) if possible.size else 0.0
        self._deviation = self._settings.reward_deviation * (scale or 1.0)
        self._fit = np.zeros(len(base.models))
        self._preference = generator.permutation(len(base.models))
        self._seen = np.zeros(base.index.num_states, dtype=np.bool_)
        self._steps: list[_Step] = []
        self._state, self._time = -1, 0
        self._retrieved = -1
        self._retrieve()

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """Begin an episode, or go on with it."""
        self._look(observation)
        self._time = time

    def act(self, allowed: Bools) -> int:
        """Return the retrieved case's best action, or any allowed one where that is not allowed."""
        now = min(self._time, self._horizon - 1)
        return draw_action(self._policy[now, self._state], allowed, self._generator.random())

    def observe(self, action: int, observation: Observation) -> None:
        """Note a step for the next update."""
        before = self._state
        self._look(observation)
        self._steps.append(_Step(before, action, self._state, observation.reward))
        self._time += 1

    def update(self) -> None:
        """Retrieve the case that fits all observations best."""
        self._fit += self._fit_of_steps()
        self._steps = []
        self._retrieve()

    def revise(self) -> None:
        """Forget the fit of each case; the retrieved case is played on."""
        self._fit[:] = 0.0
        self._seen[:] = False
        self._steps = []

    def policy(self) -> Floats:
        """Return float64 [T, S, A], the best policy of the retrieved case."""
        return self._policy

    def explain(self) -> tuple[str, ...]:
        """Return the name of the case, and the lead of its fit."""
        best = self._fit.max()
        equal = int((self._fit >= best - 1e-9).sum())
        lines = [f"plays {self._names[self._retrieved]}, of {equal} cases that fit best"]
        if equal < len(self._fit):
            following = float(self._fit[self._fit < best - 1e-9].max())
            lines.append(f"the next fits worse by {best - following:.3g} nats")
        return tuple(lines)

    def _look(self, observation: Observation) -> None:
        self._state = self._number(observation)
        if observation.continuation and not self._seen[self._state]:
            self._seen[self._state] = True
            differs = (self._enabled[:, self._state] != observation.enabled).any(axis=1)
            self._fit += np.where(differs, self._settings.unexplained, 0.0)

    def _fit_of_steps(self) -> Floats:
        """Return float64 [N], the log-likelihood of the steps since the last update."""
        state = np.array([step.state for step in self._steps], dtype=np.int64)
        action = np.array([step.action for step in self._steps], dtype=np.int64)
        target = np.array([step.target for step in self._steps], dtype=np.int64)
        reward = np.array([step.reward for step in self._steps])
        choice = state * self._enabled.shape[2] + action
        branch, place = ranges_between(self._first[:, choice].ravel(), self._first[:, choice + 1].ravel())
        step = place % len(choice)
        off = (self._reward[branch] - reward[step]) / self._deviation
        terms = self._prob[branch] * (self._target[branch] == target[step]) * np.exp(-(off**2) / 2)
        shape = (len(self._models), len(choice))
        likelihood = np.bincount(place, terms, minlength=len(self._models) * len(choice)).reshape(shape)
        floor = np.exp(self._settings.unexplained)
        total: Floats = np.log(np.maximum(likelihood, floor)).sum(axis=-1)
        return total

    def _retrieve(self) -> None:
        best = np.flatnonzero(self._fit >= self._fit.max() - 1e-9)
        retrieved = int(best[self._preference[best].argmin()])
        if retrieved != self._retrieved:
            self._retrieved = retrieved
            self._policy = optimal_policy(self._models[retrieved], self._horizon)
