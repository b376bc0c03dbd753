"""The strategy `belief`: keep a posterior over what the domain may be, plan on it, look where it pays.

Axes: T steps, S states, A actions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from merap.belief.explanation import explain
from merap.belief.model import DomainModel, mean_and_optimistic, sampled_model
from merap.belief.optimistic_exploration import OptimisticOutcome, optimistic_plans
from merap.belief.planning import (
    IMPOSSIBLE,
    FinitePlan,
    Refined,
    information_price,
    objective_information,
    plan,
)
from merap.belief.posterior import Belief, prior_belief
from merap.belief.prior_update import updated_prior
from merap.belief.space import HypothesisSpace
from merap.belief.update import ObservedStep, observe_state, observe_step
from merap.mdp.model import Bools, Floats
from merap.systems.interface import Observation
from merap.systems.strategy import StateIndex, best_allowed

Exploration = Literal["information", "mean", "thompson"]
# From the belief, the plan on its mean, the same as a policy [T, S, A], and the start [S].
Refiner = Callable[[Belief, FinitePlan, Floats, Floats], Refined]
TIES = 1e-9
WORTH_REPLANNING = 1e-3
# Per nat, in units of the range of rewards.
NEGLIGIBLE_PRICE = 1e-3


@dataclass(frozen=True)
class BeliefSettings:
    """How `belief` explores.

    Attributes:
        exploration: `information` adds to a step's reward what it tells of the objective, at the
            price of a nat; `mean` plans on the mean alone; `thompson` plans on samples.
        information_ahead: over how many episodes knowing the objective pays. A step's information
            counts in a plan as often as the step is taken, so this price is an overestimate
            and a short time is enough (measured: ten times as much buys nothing but regret).
        episodes_ahead: over how many episodes a shorter way pays, at least: as many are taken to
            lie ahead as there have been.
        doubt: moves that are open with a probability below are not worth a thought.
    """

    exploration: Exploration = "information"
    information_ahead: float = 10.0
    episodes_ahead: float = 100.0
    doubt: float = 1e-3


class BeliefStrategy:
    """Adapts by inference; see `strategy.Strategy`.

    Args:
        space: the hypotheses of the case.
        horizon: T.
        generator: of samples, and of preferences among equally good actions.
        settings: how it explores.
        refine: looks for a better policy than the plan on the mean, to act if learning stopped; None:
            the plan is kept.
    """

    episodes_per_update = 1

    def __init__(
        self,
        space: HypothesisSpace,
        horizon: int,
        generator: np.random.Generator,
        settings: BeliefSettings | None = None,
        refine: Refiner | None = None,
    ) -> None:
        self._space = space
        self._horizon = horizon
        self._generator = generator
        self._settings = settings or BeliefSettings()
        self._refine = refine
        self._refined: Refined | None = None
        self._refined_at = 0.0
        self._index = StateIndex(space.states)
        scale = TIES * (float(np.ptp(space.reward)) or 1.0)
        self._ties = scale * generator.random((len(space.actions), space.num_states))
        self._lexicographic = any(table.telling.any() for table in space.actions)
        self.belief = prior_belief(space)
        self._start = space.initial
        self._state, self._time = -1, 0
        self._negligible = NEGLIGIBLE_PRICE * scale / TIES
        self._episodes = -1
        self._price = 0.0
        self._tried: OptimisticOutcome | None = None
        self._modelled: Belief | None = None
        self._restriction: Bools | None = None
        self.update()
        self._acting, self._planned_at, self._learned = self._plan, 0, 0.0

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        """An episode begins or goes on; only its first state is where policies start."""
        self._tried = None
        self._state, self._time = self._index(observation), time
        if time == 0:
            self._start = np.zeros(self._space.num_states)
            self._start[self._state] = 1.0
        self.belief = observe_state(self._space, self.belief, self._state, observation)
        self._replan()

    def act(self, allowed: Bools) -> int:
        """The next action; later than T the last step's."""
        if self.belief.learned - self._learned > WORTH_REPLANNING:
            self._replan()
        now = min(self._time - self._planned_at, len(self._acting.ranked) - 1)
        return best_allowed(self._acting.ranked[now, self._state], allowed)

    def revise(self) -> None:
        """Begin with a mixture of the prior and of what was believed; see `prior_update`."""
        self._space = updated_prior(self._space, self.belief)
        self.belief = prior_belief(self._space)
        self._modelled, self._learned, self._refined_at = None, -np.inf, -np.inf

    def restrict(self, mask: Bools) -> None:
        """Plan with the actions bool [S, A] alone; a row without any is not restricted."""
        own = self._space.inward(mask, True)[:-1]
        rows = own | ~own.any(axis=1, keepdims=True)
        self._restriction = rows.T
        self._modelled, self._learned, self._stale = None, -np.inf, True

    def _restricted(self, model: DomainModel) -> DomainModel:
        if self._restriction is None:
            return model
        left = model.enabled & self._restriction
        return replace(model, enabled=np.where(left.any(axis=0), left, model.enabled))

    def _replan(self) -> None:
        """For the steps that remain, one at least."""
        remaining = max(self._horizon - self._time, 1)
        self._planned_at, self._learned = self._time, self.belief.learned
        if self._settings.exploration == "thompson":
            model = self._restricted(sampled_model(self._space, self.belief, self._generator))
            self._acting = plan(model, remaining, ties=self._ties)
            return
        model, optimistic = self._models()
        extra = self._bonus(model)
        self._acting = plan(model, remaining, extra, self._ties)
        if extra is None and self._settings.exploration == "information":
            self._acting = self._optimistic_plan(model, optimistic, self._acting) or self._acting

    def _models(self) -> tuple[DomainModel, DomainModel]:
        """Return the mean and the optimistic model, made once for a belief."""
        if self._modelled is not self.belief:
            self._modelled = self.belief
            mean, optimistic = mean_and_optimistic(self._space, self.belief, self._settings.doubt)
            self._mean_and_optimistic = self._restricted(mean), self._restricted(optimistic)
        return self._mean_and_optimistic

    def _optimistic_plan(
        self, model: DomainModel, optimistic: DomainModel, best: FinitePlan
    ) -> FinitePlan | None:
        """Return the first optimistic plan that pays; None: none does."""
        episodes = max(self._settings.episodes_ahead, self._episodes)
        for found, daring in optimistic_plans(model, best, optimistic, self._state, self._ties):
            if found.pays(episodes):
                self._tried = found
                return daring
        return None

    def _bonus(self, model: DomainModel) -> Floats | None:
        if self._price < self._negligible:
            return None
        return self._price * objective_information(self._space, self.belief, model)

    def observe(self, action: int, observation: Observation) -> None:
        """What a step has led to."""
        target = self._index(observation)
        step = ObservedStep(self._state, action, target, observation.reward)
        self.belief = observe_step(self._space, self.belief, step)
        self._state = target
        self._time += 1
        self.belief = observe_state(self._space, self.belief, self._state, observation)

    def update(self) -> None:
        """Plan on what is believed now."""
        self._plan_on_mean()
        self._price = 0.0
        self._episodes += 1
        if self._settings.exploration == "information":
            price = information_price(self._space, self.belief, self._model, self._plan, self._start)
            self._price = self._settings.information_ahead * price
        self._improve()

    def _improve(self) -> None:
        """Look for a better policy than the plan, unless nothing was learned since there was none."""
        if self._refine is None:
            return
        settled = self._refined is not None and self._refined.refined_value is None
        if not settled or self.belief.learned - self._refined_at > WORTH_REPLANNING:
            self._refined = self._refine(self.belief, self._plan, self._planned(), self._start)
            self._refined_at = self.belief.learned

    def _plan_on_mean(self) -> None:
        self._model, _ = self._models()
        self._plan = plan(self._model, self._horizon, ties=self._ties)
        self._stale = False

    def policy(self) -> Floats:
        """float64 [T, S, A]: the best plan on the mean model, or the refined meta policy."""
        if self._stale:
            self._plan_on_mean()
        table = self._planned()
        if self._refined is not None and self._refined.policy is not None:
            table = np.repeat(self._refined.policy[np.newaxis], len(table), axis=0)
        uniform = 1 / table.shape[2]
        completed = np.full((len(table), 1, table.shape[2]), uniform)
        return self._space.outward(np.concatenate([table, completed], axis=1), uniform)

    def _planned(self) -> Floats:
        """float64 [T, S, A] without the completed state."""
        return _by_rank(self._plan.ranked) if self._lexicographic else _best(self._plan)

    def explain(self) -> tuple[str, ...]:
        """What is believed, and what that means for the next episode."""
        if self._settings.exploration == "thompson":
            reason = "acts on a sample of the belief"
        elif self._price >= self._negligible:
            reason = f"looks for the objective, at {self._price:.2g} a nat"
        else:
            reason = "acts on the mean of the belief"
        if self._tried is not None:
            chance, gain = self._tried.chance, self._tried.gain
            reason += f"; tried what was held open with probability {chance:.2g}, for a gain of {gain:.2g}"
        lines = explain(self._space, self.belief, reason)
        return lines if self._refined is None else (*lines, self._refined.reason)


def _best(best: FinitePlan) -> Floats:
    """float64 [T, S, A], deterministic."""
    chosen: Floats = (best.actions[..., np.newaxis] == np.arange(best.ranked.shape[2])).astype(np.float64)
    return chosen


def _by_rank(ranked: Floats) -> Floats:
    """float64 [T, S, A]: all but certainly the best action that turns out to be enabled."""
    rank = np.argsort(np.argsort(-ranked, axis=-1, kind="stable"), axis=-1)
    share = np.where(ranked > IMPOSSIBLE / 2, 1e-9 ** rank.astype(np.float64), 0.0)
    return np.asarray(share / np.maximum(share.sum(axis=-1, keepdims=True), 1e-300))
