"""Many robots explore one system side by side, each behind a shield of its own: no loop over episodes.

Every robot keeps a posterior over the models of a base. In each episode it draws one of them (Thompson
sampling), follows the best plan for it among the actions the shield's threshold leaves, and tries any
allowed action now and then. Its shield holds for the models that are credible to it when the episode
begins. Robots with the same credible models share one solution.

Axes: B robots, E episodes of each, N models, G sets of credible models, and S, A, T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, UNSAFE_LABEL
from merap.mdp.simulation import simulator
from merap.shield.budget import permitted, spent
from merap.shield.models import credible_models
from scripts.bench.shield_planning import Guide, Plans

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Episodes:
    """What happened.

    Attributes:
        violated: bool [E, B], an unsafe state was reached.
        completed: bool [E, B], the task was completed.
        returns: float64 [E, B], undiscounted.
        fallbacks: steps with nothing within the budget.
        beyond_from_start: episodes that began where nothing could be promised.
        credible: float64 [E], how many models were credible to a robot, on average.
    """

    violated: Bools
    completed: Bools
    returns: Floats
    fallbacks: int
    beyond_from_start: int
    credible: Floats

    @property
    def violation_limit(self) -> float:
        """The upper end of the 95 % confidence interval of the rate of violations (Clopper and Pearson)."""
        return rate_limit(int(self.violated.sum()), self.violated.size)

    @property
    def episodes_to_goal(self) -> Floats:
        """float64 [B], the episode, counted from 1, that a robot first completed its task in; inf: none."""
        first = self.completed.argmax(axis=0) + 1.0
        return np.where(self.completed.any(axis=0), first, np.inf)


def rate_limit(count: int, trials: int) -> float:
    """Return the upper end of the two-sided Clopper-Pearson interval of a rate."""
    if count == trials:
        return 1.0
    return float(beta.ppf((1 + CONFIDENCE) / 2, count + 1, trials - count))


@dataclass(frozen=True)
class Habits:
    """How the robots explore.

    Attributes:
        threshold: lambda of their shields; None: they have none.
        exploring: how often any allowed action is tried.
        doubt: see `models.credible_models`.
    """

    threshold: float | None
    exploring: float = 0.2
    doubt: float = 1e-4


def explore(
    true: TabularMDP,
    models: Sequence[TabularMDP],
    habits: Habits,
    *,
    robots: int,
    episodes: int,
    horizon: int,
    generator: np.random.Generator,
) -> Episodes:
    """Let robots explore a system.

    Random numbers are drawn alike whatever the habits: with the same seed the same robots start and
    draw alike with a shield and without.

    Args:
        true: what is there, canonical, with label `unsafe`.
        models: N that the robots hold possible, on the same index.
        habits: of the robots.
        robots: B.
        episodes: E.
        horizon: T.
        generator: of every draw.
    """
    plans = Plans(models, habits.threshold, horizon)
    likelihood = _likelihood(models)
    weights = np.zeros((robots, len(models)))
    rounds = []
    for _ in range(episodes):
        posterior = np.exp(weights - weights.max(axis=1, keepdims=True))
        posterior /= posterior.sum(axis=1, keepdims=True)
        credible = credible_models(np.full(len(models), 1 / len(models)), posterior, habits.doubt)
        uniform = generator.random((robots, 1))
        drawn = np.minimum((posterior.cumsum(axis=1) < uniform).sum(axis=1), len(models) - 1)
        found = _Round(true, habits, horizon, generator).play(
            plans.guide(credible, drawn), weights, likelihood
        )
        rounds.append((*found, credible.sum(axis=1).mean()))
    violated, completed, returns, fallbacks, beyond, left = zip(*rounds, strict=True)
    return Episodes(
        violated=np.stack(violated),
        completed=np.stack(completed),
        returns=np.stack(returns),
        fallbacks=sum(fallbacks),
        beyond_from_start=sum(beyond),
        credible=np.array(left),
    )


def _likelihood(models: Sequence[TabularMDP]) -> Floats:
    """Return float64 [N, S, A, S], the log-probability of each step."""
    first = models[0]
    table = np.zeros((len(models), first.num_states, first.num_actions, first.num_states))
    for number, model in enumerate(models):
        choice = model.branch_choice
        table[number, model.choice_state[choice], model.choice_action[choice], model.branch_target] = (
            model.branch_prob
        )
    with np.errstate(divide="ignore"):
        logarithm: Floats = np.log(table)
    return logarithm


class _Round:
    """One episode of every robot."""

    def __init__(
        self, true: TabularMDP, habits: Habits, horizon: int, generator: np.random.Generator
    ) -> None:
        self.true, self.habits, self.horizon, self.generator = true, habits, horizon, generator
        self.system = simulator([true])
        self.unsafe = true.labels[UNSAFE_LABEL]

    def play(
        self, guide: Guide, weights: Floats, likelihood: Floats
    ) -> tuple[Bools, Bools, Floats, int, int]:
        """Return violated, completed, return of each robot; fallbacks; robots beyond the threshold at first.

        Changes `weights`, float64 [B, N], by what the robots see.
        """
        robots, system = len(weights), self.system
        state = system.first_states(np.zeros(robots, dtype=np.int64), self.generator.random(robots))
        budget = np.full(robots, self.habits.threshold or 0.0)
        beyond = 0
        if guide.risk is not None:
            least = guide.risk.of_states[guide.group * self.true.num_states + state]
            beyond = int(np.count_nonzero(least > budget + guide.risk.residual))
        violated, returns, fallbacks = self.unsafe[state], np.zeros(robots), 0
        for t in range(self.horizon):
            uniform = self.generator.random((3, robots))
            active = np.flatnonzero(~system.completed[state])
            place = guide.group[active] * self.true.num_states + state[active]
            allowed = system.choice[state[active]] >= 0
            if guide.risk is not None:
                left = budget[active, np.newaxis]
                allowed, none = permitted(guide.risk, place[:, np.newaxis], left, allowed)
                fallbacks += int(none.sum())
            planned = guide.plan[:, guide.chosen[active], t, state[active]]
            action = self._action(allowed, planned, uniform[:2, active])
            branch = system.successors.draw(system.choice[state[active], action], uniform[2, active])
            successor = system.target[branch]
            if guide.risk is not None and self.habits.threshold is not None:
                onward = place - state[active] + successor
                budget[active] = spent(
                    guide.risk, self.habits.threshold, place, action, onward, budget[active]
                )
            _learn(weights, active, likelihood[:, state[active], action, successor].T)
            returns[active] += system.reward[branch]
            state[active] = successor
            violated = violated | self.unsafe[state]
        return violated, self.true.labels[COMPLETE_LABEL][state], returns, fallbacks, beyond

    def _action(self, allowed: Bools, planned: Ints, uniform: Floats) -> Ints:
        """Return int64 [B], the first of two planned actions int64 [2, B] that is allowed, or any that is."""
        count = allowed.sum(axis=1)
        wanted = np.minimum((uniform[0] * count).astype(np.int64), count - 1)
        action = np.asarray((allowed.cumsum(axis=1) > wanted[:, np.newaxis]).argmax(axis=1))
        follows = uniform[1] >= self.habits.exploring
        for plan in planned[::-1]:
            possible = (plan >= 0) & (plan < allowed.shape[1])
            inside = np.where(possible, plan, 0)
            kept = follows & possible & allowed[np.arange(len(plan)), inside]
            action = np.where(kept, plan, action)
        return action


def _learn(weights: Floats, active: Ints, told: Floats) -> None:
    """Apply Bayes' rule in logs, [B', N]; an observation that no model allows is left out."""
    possible = np.isfinite(weights[active] + told).any(axis=1)
    weights[active[possible]] += told[possible]
