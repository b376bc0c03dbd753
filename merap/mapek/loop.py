"""The loop: monitor, analyse, shield, learn, plan and execute, episode by episode.

The way of an observation to an action; each message is made in one module and named in `messages`:

    managed system -> executor -(Execution)-> loop -> monitor -(Monitored)-> analyzer -(Analysis)->
    shield -> learner -> planner -(Plan)-> executor -> managed system
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from merap.mapek.analyzer import Analyzer
from merap.mapek.base_extension import BaseExtender, BaseExtension
from merap.mapek.executor import Executor
from merap.mapek.instrumented import InstrumentedSystem
from merap.mapek.learner import Learner
from merap.mapek.messages import AdaptedPolicy, Analysis, Execution, Monitored, Phase
from merap.mapek.monitor import Monitor
from merap.mapek.plain_analyzer import PlainAnalyzer
from merap.mapek.planner import Planner
from merap.mapek.records import Decision, EpisodeLog, Kind, Problem
from merap.mdp.index import FamilyIndex
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.shield.learning_shield import Shield
from merap.systems.deadline import DeadlineRunner
from merap.systems.interface import ManagedSystem
from merap.systems.retrying import RetryingSystem


@dataclass(frozen=True, eq=False)
class Components:
    """The components of one loop.

    Attributes:
        index: S states, of which the monitor and the policies speak.
        system: the system under control, with what the report asks of it.
        wrapped: the same, as the executor sees it after the recorded episodes.
        monitor: receives the answers of the system.
        analyzer: believes what the domain is like, and notices changes.
        shield: says which actions are safe enough.
        learner: adapts the policy.
        planner: chooses the next action.
        executor: acts on the system.
        runner: keeps the deadline of a plan, and runs the learner beside the loop.
        extender: adds to the base what it lacks; None: nothing is added.
        adapts: whether the policy is adapted before it is carried out.
    """

    index: FamilyIndex
    system: InstrumentedSystem
    wrapped: ManagedSystem
    monitor: Monitor
    analyzer: Analyzer | PlainAnalyzer
    shield: Shield
    learner: Learner
    planner: Planner
    executor: Executor
    runner: DeadlineRunner
    extender: BaseExtender | None
    adapts: bool

    def close(self) -> None:
        """End the threads that keep deadlines."""
        self.runner.close()
        if isinstance(self.wrapped, RetryingSystem):
            self.wrapped.close()


class Loop:
    """Controls a managed system through its components.

    During an episode the learner works beside the loop, and takes up its messages in order. Nothing is shared
    with it but messages: the decisions of the loop depend on the clock only through the plans that were
    late, which are recorded. At the end of an episode nothing is due, so the loop waits for the learner.

    Args:
        components: made for this loop alone.
    """

    def __init__(self, components: Components) -> None:
        self._monitor = components.monitor
        self._analyzer = components.analyzer
        self._shield = components.shield
        self._learner = components.learner
        self._planner = components.planner
        self._executor = components.executor
        self._runner = components.runner
        self._extender = components.extender
        self._episode = -1
        self._phase: Phase = "adapting"
        self._mask: Bools | None = None
        self._restrict()
        self._expect()
        self._wait()
        if not components.adapts:
            self._settle()

    @property
    def table(self) -> Floats:
        """float64 [S, A] or [T, S, A], the policy that would act if learning stopped now."""
        return self._planner.table

    def episode(self) -> EpisodeLog:
        """Control one episode, whatever the system does."""
        begun = time.monotonic()
        self._episode += 1
        phase = self._phase
        self._executions: list[Execution] = []
        self._decisions: list[Decision] = []
        self._problems: list[Problem] = []
        self._model: TabularMDP | None = None
        self._extension: BaseExtension | None = None
        self._learner.begin_episode()
        self._shield.begin()
        monitored, analysis = self._take_in(self._executor.reset())
        while not monitored.last:
            monitored, analysis = self._take_in(self._act(monitored, analysis))
        policy = self._end_episode(monitored)
        return EpisodeLog(
            episode=self._episode,
            phase=phase,
            executions=tuple(self._executions),
            decisions=tuple(self._decisions),
            problems=tuple(self._problems),
            policy=policy,
            model=self._model,
            extension=self._extension,
            seconds=time.monotonic() - begun,
        )

    def _take_in(self, execution: Execution) -> tuple[Monitored, Analysis]:
        """Monitor and analyse the answer of the system; shield and learner follow."""
        self._executions.append(execution)
        monitored = self._monitor.receive(execution)
        self._problems += [Problem(monitored.step, message) for message in monitored.problems]
        analysis = self._analyzer.analyse(monitored)
        self._shield.follow(monitored.news, None if monitored.problems else monitored.enabled)
        if analysis.replan:
            self._decide(monitored, "replan", analysis.reasons)
            self._shield.forget(monitored.news[-1].observation if monitored.news else None)
            self._replan()
        self._restrict()
        self._phase = analysis.phase
        if analysis.phase == "adapting":
            self._runner.later(lambda: self._learner.learn_from(monitored))
        return monitored, analysis

    def _act(self, monitored: Monitored, analysis: Analysis) -> Execution:
        """Plan an action that the shield allows, and execute it."""
        allowed = self._shield.allowed(monitored.enabled)
        plan = self._planner.plan(monitored, analysis, allowed)
        if plan.source == "fallback":
            self._decide(monitored, "fallback", (plan.reason,))
        execution = self._executor.execute(plan)
        taken = plan.action if execution.action is None else execution.action
        self._shield.took(taken, surely=execution.observation is not None)
        return execution

    def _replan(self) -> None:
        self._runner.later(self._learner.replan)
        self._mask = None
        self._restrict()
        self._expect()

    def _restrict(self) -> None:
        """Let the learner plan within what the shield could allow."""
        mask = self._shield.mask
        if mask is not None and (self._mask is None or not np.array_equal(mask, self._mask)):
            self._mask = mask
            self._runner.later(lambda: self._learner.restrict(mask))

    def _expect(self) -> None:
        """Let the planner carry out the policy of the learner within the shield, once it is made."""
        made = self._runner.later(self._learner.policy)
        self._planner.expect(lambda: self._shield.masked(made.result().table))

    def _wait(self) -> None:
        self._runner.finish()
        self._planner.catch_up()

    def _end_episode(self, monitored: Monitored) -> AdaptedPolicy | None:
        """Wait for the learner, and carry out its policy if it was updated."""
        self._wait()
        if self._phase == "executing":
            return None
        policy = self._learner.end_episode()
        if policy is None:
            return None
        self._decide(monitored, "update", policy.reasons)
        self._planner.adopt(self._shield.masked(policy.table))
        if self._analyzer.enough(policy):
            self._decide(monitored, "settled", self._analyzer.explain())
            self._settle()
            self._extend(monitored)
        return policy

    def _extend(self, monitored: Monitored) -> None:
        """Learn offline again, if the domain is outside the base."""
        analyzer = self._analyzer
        if self._extender is None or self._model is None or isinstance(analyzer, PlainAnalyzer):
            return
        self._extension = self._extender.extend(self._episode, analyzer.belief, self._model)
        if self._extension is not None:
            self._learner.relearned(self._extension.make)
            analyzer.adopt_prior(self._extension.hypotheses)
            self._decide(monitored, "extended", self._extension.reasons)

    def _settle(self) -> None:
        self._phase = "executing"
        self._analyzer.settle(self.table)
        self._model = self._analyzer.tabular()

    def _decide(self, monitored: Monitored, kind: Kind, reasons: tuple[str, ...]) -> None:
        self._decisions.append(Decision(monitored.step, kind, reasons))
