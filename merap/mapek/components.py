"""Make the components of a loop for a scenario."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from merap.belief.steps import beyond_places_and_modes
from merap.concerns.case_study import CaseStudy
from merap.mapek.analyzer import Analyzer
from merap.mapek.base_extension import BaseExtender
from merap.mapek.connecting import live_horizon
from merap.mapek.executor import Executor
from merap.mapek.instrumented import InstrumentedSystem
from merap.mapek.learner import Learner
from merap.mapek.live_system import Disconnected, LiveSystem
from merap.mapek.loop import Components
from merap.mapek.managers import Manager, make_manager, require_strategy
from merap.mapek.monitor import Monitor, Sensors
from merap.mapek.plain_analyzer import PlainAnalyzer
from merap.mapek.planner import Planner
from merap.mapek.recorded_system import RecordedSystem
from merap.mapek.run_store import NO_HISTORY, RunHistory
from merap.mapek.scenario import Scenario
from merap.mapek.scenario_schema import ScenarioSpec
from merap.mapek.scenario_system import ScenarioSystem
from merap.runs.run_folder import RunFolder
from merap.shield.learning_shield import LearningShield, Shield, ShieldSettings, Unshielded
from merap.strategies.registry import StrategyContext
from merap.systems.deadline import DeadlineRunner
from merap.systems.interface import ManagedSystem
from merap.systems.retrying import Retries
from merap.trigger.change import ChangeTrigger
from merap.trigger.settings import ChangeSettings, WindowSettings
from merap.trigger.trigger import Trigger
from merap.trigger.window import WindowTrigger

Wrapper = Callable[[InstrumentedSystem], ManagedSystem]


def unwrapped(system: InstrumentedSystem) -> ManagedSystem:
    """Return the system as it is."""
    return system


def make_components(
    run: RunFolder,
    scenario: Scenario,
    manager: str,
    history: RunHistory = NO_HISTORY,
    wrap: Wrapper = unwrapped,
    live: ManagedSystem | None = None,
) -> Components:
    """Make the components of a loop before its first episode.

    Args:
        run: a finished training run.
        scenario: the system, and its changes.
        manager: one of `managers.MANAGERS`.
        history: episodes that are repeated from records before the system is used.
        wrap: stands between the loop and the system.
        live: the system of a scenario that does not simulate it, see `connecting.connected`; None: it is not
            connected, so that nothing but the history can be repeated.

    Raises:
        InputError: the scenario does not fit the case, or a name is unknown.
    """
    spec, case = scenario.spec, run.case
    require_strategy(scenario, run.names)
    fallback = scenario.action(case)
    drawn = np.random.default_rng(spec.seed).spawn(4)
    of_system, of_sensors, of_learner, of_planner = drawn
    system = _managed_system(scenario, case, live, of_system)
    horizon = system.horizon
    context = StrategyContext(run, horizon, case.discount, spec.strategy.episodes_per_step, met=system.models)
    chosen = make_manager(manager, spec.strategy, context)
    learner = Learner(chosen.make, of_learner, restart=spec.strategy.replan_from == "meta")
    runner = DeadlineRunner(spec.deadline.seconds)
    late = {(one.row.episode, step): how for one in history.episodes for step, how in one.late.items()}
    wrapped = wrap(system)
    recorded = RecordedSystem(history.episodes, wrapped) if history.episodes else wrapped
    return Components(
        index=context.index,
        system=system,
        wrapped=wrapped,
        monitor=Monitor(context.index, len(case.actions), Sensors(spec.sensing, of_sensors)),
        analyzer=_analyzer(spec, context, chosen),
        shield=_shield(scenario, context),
        learner=learner,
        planner=Planner(learner, fallback, runner, of_planner, late),
        executor=Executor(recorded),
        runner=runner,
        extender=_extender(spec, manager, context) if chosen.replans else None,
        adapts=chosen.updates != 0,
    )


def _managed_system(
    scenario: Scenario, case: CaseStudy, live: ManagedSystem | None, generator: np.random.Generator
) -> InstrumentedSystem:
    spec = scenario.spec
    if spec.live is not None:
        there = live or Disconnected(case.actions)
        horizon = live_horizon(spec.live, case)
        return LiveSystem(there, horizon, case.discount, Retries(spec.live.retries))
    threshold = None if spec.shield is None else spec.shield.threshold
    return ScenarioSystem(scenario.stages(case), spec.noise, spec.reset, generator, threshold)


def _analyzer(spec: ScenarioSpec, context: StrategyContext, manager: Manager) -> Analyzer | PlainAnalyzer:
    case = context.run.case
    if beyond_places_and_modes(case.combination_at(0)) is not None:
        return PlainAnalyzer(context.index.num_states, manager.updates)
    settings = _trigger_settings(spec)
    return Analyzer(
        context.hypotheses,
        context.horizon,
        manager.updates,
        make_trigger(settings, case.discount) if manager.replans else None,
        settings if isinstance(settings, ChangeSettings) else None,
        forget=spec.strategy.replan_from == "meta",
    )


def _extender(spec: ScenarioSpec, manager: str, context: StrategyContext) -> BaseExtender | None:
    if not spec.learning.extend:
        return None
    return BaseExtender(
        context, lambda known: make_manager(manager, spec.strategy, known).make, spec.learning.updates
    )


def _trigger_settings(spec: ScenarioSpec) -> ChangeSettings | WindowSettings | None:
    """Return the settings of the file; the trigger is told the noise on rewards if the file does not."""
    given = spec.trigger.settings
    if isinstance(given, ChangeSettings) and spec.noise.reward > 0 and "noise" not in given.model_fields_set:
        return given.model_copy(update={"noise": spec.noise.reward})
    return given


def make_trigger(settings: ChangeSettings | WindowSettings | None, discount: float) -> Trigger | None:
    """Return the trigger that the settings describe.

    Args:
        settings: None: never re-plan.
        discount: discount of a step, as the case has it; a window counts with it unless it has its own.
    """
    if isinstance(settings, ChangeSettings):
        return ChangeTrigger(settings)
    if isinstance(settings, WindowSettings):
        own = settings.discount is not None
        return WindowTrigger(settings if own else settings.model_copy(update={"discount": discount}))
    return None


def _shield(scenario: Scenario, context: StrategyContext) -> Shield:
    spec = scenario.spec.shield
    if spec is None:
        return Unshielded()
    with scenario.document.at("shield"):
        settings = ShieldSettings(spec.threshold, spec.hazard_prior)
        return LearningShield(context.hypotheses, context.horizon, settings)
