"""Puts the parts of a loop together for a scenario."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from merap.belief.space import HypothesisSpace
from merap.closing import Closing
from merap.concerns.case_study import CaseStudy
from merap.learning.run_folder import RunFolder
from merap.mapek.analyzer import Analyzer
from merap.mapek.base_extension import Extender
from merap.mapek.connecting import live_horizon
from merap.mapek.executor import Executor
from merap.mapek.ground_truth import truths
from merap.mapek.instrumented import MetSystem
from merap.mapek.learner import Learner
from merap.mapek.live_system import Disconnected, LiveSystem
from merap.mapek.loop import Parts
from merap.mapek.loop_shield import LoopShield
from merap.mapek.managers import make_manager
from merap.mapek.monitor import Monitor
from merap.mapek.planner import Planner
from merap.mapek.recorded_system import RecordedSystem
from merap.mapek.run_store import NOTHING, Past
from merap.mapek.scenario import Scenario
from merap.mapek.scenario_schema import ScenarioSpec
from merap.mapek.scenario_system import ScenarioSystem
from merap.mapek.sensors import Sensors
from merap.mapek.strategy_check import require_strategy
from merap.shield.learning_shield import ShieldSettings
from merap.strategies.registry import StrategyContext
from merap.systems.deadline import Punctual
from merap.systems.interface import ManagedSystem
from merap.systems.retrying import GuardedSystem, Retries
from merap.trigger.making import make_trigger
from merap.trigger.settings import ChangeSettings, WindowSettings


@dataclass(frozen=True, eq=False)
class Built(Closing):
    """A loop and what it meets; a context at whose end the threads that keep deadlines are closed.

    Attributes:
        parts: of the loop.
        system: that is controlled.
        guarded: the same, as the loop sees it.
        shield: of the loop; None: there is none.
        adapts: whether the policy is adapted before it is carried out.
    """

    parts: Parts
    system: MetSystem
    guarded: ManagedSystem
    shield: LoopShield | None
    adapts: bool

    def close(self) -> None:
        """End the threads that keep deadlines."""
        self.parts.punctual.close()
        if isinstance(self.guarded, GuardedSystem):
            self.guarded.close()


Guard = Callable[[MetSystem], ManagedSystem]


def unguarded(system: MetSystem) -> ManagedSystem:
    """The system as it is."""
    return system


def build(
    run: RunFolder,
    scenario: Scenario,
    manager: str,
    past: Past = NOTHING,
    guard: Guard = unguarded,
    live: ManagedSystem | None = None,
) -> Built:
    """A loop before its first episode.

    Args:
        run: a finished training run.
        scenario: what is met.
        manager: one of `managers.MANAGERS`.
        past: episodes that are repeated from records before the system is used.
        guard: what stands between the loop and the system.
        live: the system of a scenario that does not simulate it, see `connecting.connected`; None: it is not
            connected, so that nothing but the past can be repeated.

    Raises:
        InputError: the scenario does not fit the case, or a name is unknown.
    """
    spec, case = scenario.spec, run.case
    require_strategy(scenario, run.names)
    fallback = scenario.action(case)
    drawn = np.random.default_rng(spec.seed).spawn(4)
    of_system, of_sensors, of_learner, of_planner = drawn
    system = _met(scenario, case, live, of_system)
    horizon = system.horizon
    context = StrategyContext(run, horizon, case.discount, spec.strategy.episodes_per_step)
    chosen = make_manager(manager, spec.strategy, context)
    restart = spec.strategy.replan_from == "meta"
    learner = Learner(chosen.make, of_learner, restart=restart)
    settings = _trigger_settings(spec)
    trigger = make_trigger(settings, case.discount) if chosen.replans else None
    readings = settings if isinstance(settings, ChangeSettings) else None
    analyzer = Analyzer(context.hypotheses, horizon, chosen.updates, trigger, readings, forget=restart)
    shield = _shield(scenario, context.hypotheses, horizon)
    punctual = Punctual(spec.deadline.seconds)
    late = {(one.row.episode, step): how for one in past.episodes for step, how in one.late.items()}
    guarded = guard(system)
    parts = Parts(
        monitor=Monitor(context.valuations, len(case.actions), Sensors(spec.sensing, of_sensors)),
        analyzer=analyzer,
        learner=learner,
        planner=Planner(learner, fallback, punctual, of_planner, late),
        executor=Executor(RecordedSystem(past.episodes, guarded), shield),
        punctual=punctual,
        extender=_extender(spec, manager, context) if chosen.replans else None,
    )
    return Built(parts, system, guarded, shield, chosen.updates != 0)


def _met(
    scenario: Scenario, case: CaseStudy, live: ManagedSystem | None, generator: np.random.Generator
) -> MetSystem:
    spec = scenario.spec
    if spec.live is not None:
        there = live or Disconnected(case.actions)
        horizon = live_horizon(spec.live, case)
        return LiveSystem(there, horizon, case.discount, Retries(spec.live.retries))
    threshold = None if spec.shield is None else spec.shield.threshold
    stages = truths(scenario.stages(case), spec.noise.slip, threshold)
    return ScenarioSystem(stages, spec.noise, spec.reset, generator)


def _extender(spec: ScenarioSpec, manager: str, context: StrategyContext) -> Extender | None:
    if not spec.learning.extend:
        return None
    return Extender(
        context, lambda known: make_manager(manager, spec.strategy, known).make, spec.learning.updates
    )


def _trigger_settings(spec: ScenarioSpec) -> ChangeSettings | WindowSettings | None:
    """Those of the file; the noise on rewards is stated to the trigger."""
    given = spec.trigger.settings
    if isinstance(given, ChangeSettings) and spec.noise.reward > 0 and "noise" not in given.model_fields_set:
        return given.model_copy(update={"noise": spec.noise.reward})
    return given


def _shield(scenario: Scenario, space: HypothesisSpace, horizon: int) -> LoopShield | None:
    spec = scenario.spec.shield
    if spec is None:
        return None
    with scenario.document.at("shield"):
        return LoopShield(space, horizon, ShieldSettings(spec.threshold, spec.hazard_prior))
