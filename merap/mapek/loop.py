"""The loop: monitor, analyse, plan, execute, and learn, episode by episode."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from merap.mapek.analyzer import Analyzer
from merap.mapek.base_extension import Extender, Extension
from merap.mapek.executor import Executor
from merap.mapek.learner import Learner
from merap.mapek.messages import AdaptedPolicy, Analysis, Execution, Monitored, Phase, Plan
from merap.mapek.monitor import Monitor
from merap.mapek.planner import Planner
from merap.mapek.records import Decision, EpisodeLog, Kind, Problem
from merap.mdp.model import Bools, Floats, TabularMDP
from merap.systems.deadline import Punctual


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts of a loop, made for one run of it."""

    monitor: Monitor
    analyzer: Analyzer
    learner: Learner
    planner: Planner
    executor: Executor
    punctual: Punctual
    extender: Extender | None


class Loop:
    """Controls a managed system through its parts.

    Whatever the learner is told during an episode it is told beside the loop, in order. Nothing is shared
    with it but messages: what the loop decides depends on the clock only through the plans that were
    late, which are recorded. At the end of an episode nothing is due, so the learner is waited for.

    Args:
        parts: fresh ones.
        adapts: whether the policy is adapted before it is carried out.
    """

    def __init__(self, parts: Parts, *, adapts: bool = True) -> None:
        self._parts = parts
        self._episode = -1
        self._phase: Phase = "adapting"
        self._mask: Bools | None = None
        self._restrict()
        self._expect()
        self._wait()
        if not adapts:
            self._settle()

    @property
    def table(self) -> Floats:
        """float64 [S, A] or [T, S, A], the policy that would act if learning stopped now."""
        return self._parts.planner.table

    def episode(self) -> EpisodeLog:
        """One episode, whatever the system does."""
        begun = time.monotonic()
        self._episode += 1
        phase = self._phase
        self._executions: list[Execution] = []
        self._decisions: list[Decision] = []
        self._problems: list[Problem] = []
        self._model: TabularMDP | None = None
        self._extension: Extension | None = None
        parts = self._parts
        parts.learner.begin()
        monitored, analysis = self._take_in(parts.executor.reset())
        while not monitored.last:
            monitored, analysis = self._take_in(parts.executor.execute(self._plan(monitored, analysis)))
        policy = self._learn(monitored)
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
        """Monitor and analyse what has come back."""
        self._executions.append(execution)
        parts = self._parts
        monitored = (
            parts.monitor.begin(execution) if execution.action is None else parts.monitor.observe(execution)
        )
        self._problems += [Problem(monitored.step, message) for message in monitored.problems]
        parts.executor.observe(monitored)
        analysis = parts.analyzer.analyse(monitored)
        if analysis.replan:
            self._decide(monitored, "replan", analysis.reasons)
            parts.executor.forget(monitored)
            self._replan()
        self._restrict()
        self._phase = analysis.phase
        if analysis.phase == "adapting":
            parts.punctual.later(lambda: parts.learner.observe(monitored))
        return monitored, analysis

    def _replan(self) -> None:
        self._parts.punctual.later(self._parts.learner.replan)
        self._mask = None
        self._restrict()
        self._expect()

    def _restrict(self) -> None:
        """The learner plans within what the shield could allow."""
        mask = self._parts.executor.mask()
        if mask is not None and (self._mask is None or not np.array_equal(mask, self._mask)):
            self._mask = mask
            self._parts.punctual.later(lambda: self._parts.learner.restrict(mask))

    def _expect(self) -> None:
        """Once it is made the policy is that of the learner, as the shield lets it be carried out."""
        executor = self._parts.executor
        made = self._parts.punctual.later(self._parts.learner.policy)
        self._parts.planner.expect(lambda: executor.carried_out(made.result().table))

    def _wait(self) -> None:
        self._parts.punctual.finish()
        self._parts.planner.catch_up()

    def _plan(self, monitored: Monitored, analysis: Analysis) -> Plan:
        parts = self._parts
        plan = parts.planner.plan(monitored, analysis, parts.executor.allowed(monitored))
        if plan.source == "fallback":
            self._decide(monitored, "fallback", (plan.reason,))
        return plan

    def _learn(self, monitored: Monitored) -> AdaptedPolicy | None:
        """The episode is over."""
        parts = self._parts
        self._wait()
        if self._phase == "executing":
            return None
        policy = parts.learner.end()
        if policy is None:
            return None
        self._decide(monitored, "update", policy.reasons)
        parts.planner.adopt(parts.executor.carried_out(policy.table))
        if parts.analyzer.enough(policy):
            self._decide(monitored, "settled", parts.analyzer.explain())
            self._settle()
            self._extend(monitored)
        return policy

    def _extend(self, monitored: Monitored) -> None:
        """Learn offline again, if the domain is none of the base."""
        parts = self._parts
        if parts.extender is None or self._model is None:
            return
        self._extension = parts.extender.extend(self._episode, parts.analyzer.belief, self._model)
        if self._extension is not None:
            parts.learner.relearned(self._extension.make)
            parts.analyzer.remember(self._extension.hypotheses)
            self._decide(monitored, "extended", self._extension.reasons)

    def _settle(self) -> None:
        self._phase = "executing"
        self._parts.analyzer.settle(self.table)
        self._model = self._parts.analyzer.tabular()

    def _decide(self, monitored: Monitored, kind: Kind, reasons: tuple[str, ...]) -> None:
        self._decisions.append(Decision(monitored.step, kind, reasons))
