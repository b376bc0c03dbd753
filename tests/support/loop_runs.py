"""Runs of the loop on the paper's grid, with a training run in which only the machinery matters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from merap.belief.outside import Outside
from merap.belief.space import HypothesisSpace, hypothesis_space
from merap.concerns.lookup import declared_case
from merap.mapek.analyzer import Analyzer
from merap.mapek.components import Wrapper, make_components, unwrapped
from merap.mapek.loop import Components
from merap.mapek.scenario import Scenario, read_scenario
from merap.mapek.scenario_system import ScenarioSystem
from merap.mapek.scores import LoopReport
from merap.runs.run_folder import RunFolder
from merap.systems.interface import ManagedSystem, Observation, SystemFault
from tests.support.grid_tasks import HORIZON
from tests.support.loop_examples import Doubtful

# RQ1-3: the goal is (4, 4), the robot can't enter (3, 4). Then the goal is where no model has it.
MOVED = """\
scenario: moved
system: met
episodes: 10
seed: 0
changes: [{at: {episode: 5}, objective: {goal: [2, 2]}}]
strategy: {updates: 3}
"""


def scenario(folder: Path, text: str = MOVED, more: str = "") -> Scenario:
    path = folder / "scenario.yaml"
    path.write_text(text + more, encoding="utf-8")
    return read_scenario(path)


def doubtful(
    run: RunFolder, found: Scenario, manager: str = "merap", wrap: Wrapper = unwrapped
) -> Components:
    """Return a loop whose trigger alarms at the first thing that its model holds impossible."""
    components = make_components(run, found, manager, wrap=wrap)
    analyzer = Analyzer(hypotheses_of(run, components), HORIZON, found.spec.strategy.updates, Doubtful())
    return replace(components, analyzer=analyzer)


def hypotheses_of(run: RunFolder, components: Components, outside: Outside | None = None) -> HypothesisSpace:
    """Return hypotheses whose policies are those of a loop's components."""
    return hypothesis_space(declared_case(run.case), outside, index=components.index)


def timeless(report: LoopReport) -> Mapping[str, Any]:
    """Return the report without what depends on the clock."""
    content = report.as_dict()
    del content["times"]
    return content


class Unsound:
    """Faults in every third episode: after some steps, for as many calls as it is told."""

    def __init__(self, system: ManagedSystem, calls: int) -> None:
        assert isinstance(system, ScenarioSystem)
        self.system, self.calls = system, calls
        self.left = 0

    @property
    def actions(self) -> tuple[str, ...]:
        return self.system.actions

    def reset(self) -> Observation:
        observation = self.system.reset()
        self.left = self.calls if self.system.episode % 3 == 1 else 0
        return observation

    def step(self, action: int) -> Observation:
        if self.left and self.system.tally.steps >= 2:
            self.left -= 1
            raise SystemFault("dropped", "the connection is lost", repeatable=False)
        return self.system.step(action)
