"""The analyzer: believes what the real domain is like, and notices when it has changed.

Axes: S states of the index, A declared actions, K as in `belief.actions`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from merap.belief.explanation import explain
from merap.belief.model import DomainModel, mean_model, tabular
from merap.belief.posterior import Belief, prior_belief
from merap.belief.prior_update import updated_prior
from merap.belief.space import HypothesisSpace
from merap.belief.update import ObservedStep, observe_state, observe_step
from merap.mapek.change_points import ChangePoint, ChangePoints
from merap.mapek.messages import AdaptedPolicy, Analysis, Monitored, Phase
from merap.mdp.model import Floats, TabularMDP
from merap.strategies.evaluation import evaluator, executed, reachable_range
from merap.systems.sightings import News, Transition
from merap.trigger.readings import Forecast, ObservedSteps
from merap.trigger.settings import ChangeSettings
from merap.trigger.trigger import Alarm, Reading, Trigger

# An adaptation goes on while the episodes of an update change the belief by more nats than that.
QUIET = 0.1
# It ends at the latest after that many times its least number of updates.
PATIENCE = 5


class Analyzer:
    """Keeps a belief while the learner adapts; watches its predictions while the policy is executed.

    While the policy is executed the model stays as it was when adaptation ended. If it followed the
    observations, a change would be explained away before anyone acts on it. While the policy is adapted,
    recent episodes are tried as change points, see `change_points`.

    Args:
        space: the hypotheses of the case.
        horizon: T.
        updates: policy updates of an adaptation, at least; None: it never ends.
        trigger: decides when to re-plan; None: never.
        settings: settings of the readings of the trigger.
        forget: whether re-planning starts from the prior; else from a mixture of prior and posterior.
    """

    def __init__(
        self,
        space: HypothesisSpace,
        horizon: int,
        updates: int | None,
        trigger: Trigger | None,
        settings: ChangeSettings | None = None,
        *,
        forget: bool = True,
    ) -> None:
        self._space = space
        self._believed = space.index.numbers_on(space.states)
        self._horizon = horizon
        self._updates = updates
        self._learned = 0.0
        self._trigger = trigger
        self._settings = settings or ChangeSettings()
        self._forget = forget
        self._forecast: Forecast | None = None
        self._watched = 0
        self._phase: Phase = "adapting"
        self.belief = prior_belief(space)
        self._change_points = ChangePoints(space)
        self._modelled: tuple[Belief, DomainModel] | None = None

    @property
    def model(self) -> DomainModel:
        """The mean model of the belief about the real domain."""
        if self._modelled is None or self._modelled[0] is not self.belief:
            self._modelled = self.belief, mean_model(self._space, self.belief)
        return self._modelled[1]

    def tabular(self) -> TabularMDP:
        """Return the model on the index."""
        return self._space.index.place(tabular(self._space, self.model, self._space.initial))

    def adopt_prior(self, space: HypothesisSpace) -> None:
        """Begin with the prior of these hypotheses, from the next re-planning on."""
        self._space = space

    def explain(self) -> tuple[str, ...]:
        """Return the hypotheses that are left, with their weights, in plain lines."""
        return explain(self._space, self.belief, "the analyzer's model is the mean of its belief")

    def enough(self, policy: AdaptedPolicy) -> bool:
        """Return whether an adaptation may end with this update.

        It may after its least number of updates, once the belief is quiet and the policy is about as good
        as any for the mean of the belief.
        """
        news, self._learned = self.belief.learned - self._learned, self.belief.learned
        if self._updates is None or policy.update < self._updates:
            return False
        if policy.update >= PATIENCE * self._updates:
            return True
        return news <= QUIET and self._is_good(policy.table)

    def _is_good(self, table: Floats) -> bool:
        model = self.tabular()
        reachable, value = reachable_range(model, self._horizon), evaluator(model, self._horizon)(table)
        return reachable.within_5_percent(value) or reachable.solved(value)

    def settle(self, table: Floats) -> None:
        """End an adaptation: from now on observations are held against the model.

        Args:
            table: float64 [S, A] or [T, S, A], the policy that is carried out.
        """
        self._phase = "executing"
        if self._trigger is not None:
            model = self.tabular()
            self._forecast = Forecast(model, executed(model, table), self._horizon, self._settings)

    def analyse(self, monitored: Monitored) -> Analysis:
        """Update the belief with the news, or hold the news against the model."""
        if self._phase == "executing":
            alarm = self._watch(monitored)
            if alarm is not None:
                return self._replan(monitored, alarm)
        else:
            change = self._adapt(monitored)
            if change is not None:
                return self._start_anew(monitored, change)
        return Analysis(self._phase, self._whereabouts(monitored))

    def _adapt(self, monitored: Monitored) -> ChangePoint | None:
        """Update the belief, and return a change point that explains the news far better."""
        if self._trigger is not None and monitored.step == 0:
            self._change_points.add(monitored.episode, self.belief)
        for news in monitored.news:
            self._learn(news)
        return self._change_points.convincing(self.belief)

    def _start_anew(self, monitored: Monitored, change: ChangePoint) -> Analysis:
        """Go on with the belief of a change point, which has seen nothing from before the change."""
        odds = change.log_odds(self.belief)
        self.belief = change.belief
        self._learned = self.belief.learned
        self._change_points = ChangePoints(self._space)
        reason = (
            f"the system has changed amid the adaptation: what was seen from episode {change.episode} on is "
            f"e^{odds:.1f} times likelier if all that was learned before is forgotten"
        )
        return Analysis(self._phase, self._whereabouts(monitored), replan=True, reasons=(reason,))

    def _replan(self, monitored: Monitored, alarm: Alarm) -> Analysis:
        assert self._trigger is not None
        self._trigger.replanned()
        self._phase = "adapting"
        if not self._forget:
            self._space = updated_prior(self._space, self.belief)
        self.belief = prior_belief(self._space)
        self._learned = self.belief.learned
        self._change_points = ChangePoints(self._space)
        self._change_points.add(monitored.episode, self.belief)
        for news in monitored.news:
            self._learn(news)
        where = self._whereabouts(monitored)
        return Analysis(self._phase, where, replan=True, reasons=(alarm.reason,))

    def _watch(self, monitored: Monitored) -> Alarm | None:
        """Return the first alarm that the news raise, or the end of the episode."""
        if self._trigger is None or self._forecast is None:
            return None
        if monitored.step == 0:
            self._watched = 0
        seen = [news for news in monitored.news if isinstance(news, Transition)]
        for one, reading in zip(seen, _readings(self._forecast, seen), strict=True):
            self._missed_before(one.time)
            self._watched = one.time + 1
            alarm = self._trigger.observe(reading)
            if alarm is not None:
                return alarm
        if not monitored.last:
            return None
        self._missed_before(monitored.step)
        return self._trigger.episode_over()

    def _missed_before(self, step: int) -> None:
        """Tell the trigger if a step before this one was not seen whole."""
        assert self._trigger is not None
        if step > self._watched:
            self._trigger.missed()

    def _learn(self, news: News) -> None:
        self.belief = self._taken_in(self.belief, news)
        self._change_points.update(lambda belief: self._taken_in(belief, news))

    def _taken_in(self, belief: Belief, news: News) -> Belief:
        if isinstance(news, Transition):
            state, target = self._believed[[news.state, news.target]].tolist()
            step = ObservedStep(state, news.action, target, news.observation.reward)
            belief = observe_step(self._space, belief, step)
            return observe_state(self._space, belief, target, news.observation)
        return observe_state(self._space, belief, int(self._believed[news.state]), news.observation)

    def _whereabouts(self, monitored: Monitored) -> Floats:
        """Return float64 [S], where the system may be; the episode goes on unless its end was seen."""
        space = self._space
        if monitored.state is not None:
            seen: Floats = np.eye(1, space.index.num_states, monitored.state)[0]
            return seen
        begin = space.initial
        if monitored.seen is not None:
            begin = np.eye(1, space.num_states, self._believed[monitored.seen])[0]
        where = np.append(_predicted(self.model, begin, monitored.since), 0.0)[:, np.newaxis]
        whereabouts: Floats = space.outward(where, 0.0)[:, 0]
        return whereabouts


def _readings(forecast: Forecast, seen: Sequence[Transition]) -> list[Reading]:
    """Hold steps that were seen whole against the model."""
    if not seen:
        return []
    steps = ObservedSteps(
        time=np.array([one.time for one in seen]),
        state=np.array([one.state for one in seen]),
        action=np.array([one.action for one in seen]),
        target=np.array([one.target for one in seen]),
        reward=np.array([one.observation.reward for one in seen]),
        last=np.array([one.observation.last for one in seen]),
    )
    readings = forecast.read(steps)
    return [readings[index] for index in range(len(readings))]


def _predicted(model: DomainModel, begin: Floats, actions: Sequence[int]) -> Floats:
    """Return float64 [S - 1], where the actions lead if they don't end the task."""
    here = begin
    for action in actions:
        onward = here[:, np.newaxis] * model.prob[action] * model.continuation[action]
        there = np.bincount(model.target[action].ravel(), onward.ravel(), minlength=len(here))
        # The episode is known to go on, even where the model says it can't.
        here = there / there.sum() if there.sum() > 0 else here
    return here
