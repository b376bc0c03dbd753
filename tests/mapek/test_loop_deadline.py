"""Runs of the loop with a deadline for decisions: the clock counts only where a decision is late."""

from __future__ import annotations

import itertools
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.mapek import managers
from merap.mapek.records import EpisodeRow
from merap.mapek.replaying import check_decisions
from merap.mapek.run import run_loop
from merap.mdp.model import Bools, Floats
from merap.runs.run_folder import RunFolder
from merap.shield.shielded_strategy import Restrictable
from merap.strategies.registry import StrategyContext, make_strategy
from merap.systems.deadline import Lateness
from merap.systems.interface import ManagedSystem, Observation
from merap.systems.retrying import RetryingSystem
from merap.systems.strategy import Strategy
from tests.support.loop_runs import scenario, timeless
from tests.support.paths import MODELS
from tests.support.trained_runs import trained

EXAMPLE = MODELS / "running-example"
NEVER_LATE = "deadline: {seconds: 60}\n"
# A threshold that the good policy's own windows miss now and then: re-plannings amid episodes.
NERVOUS = "trigger: {kind: window, settings: {threshold: -0.5, discount: 1.0, steps: 4}}\n"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_deadline_that_is_never_missed_changes_nothing(
    run: RunFolder, tmp_path: Path, hectic: None, seed: int
) -> None:
    text = f"""\
scenario: moved
system: met
episodes: 8
seed: {seed}
changes: [{{at: {{episode: 4}}, objective: {{goal: [2, 2]}}}}]
strategy: {{updates: 2}}
sensing: {{loss: 0.1}}
{NERVOUS}"""
    without = timeless(run_loop(run, scenario(tmp_path, text)))
    assert without["summary"]["adaptations"] > 0
    assert timeless(run_loop(run, scenario(tmp_path, text, NEVER_LATE))) == without


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "robot", case=EXAMPLE)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_nor_does_it_behind_a_shield(robot: RunFolder, tmp_path: Path, hectic: None, seed: int) -> None:
    """The shield's mask is told to a learner that is at work meanwhile."""
    text = f"""\
scenario: dark
system: {{environment: b_blocked, capability: speed_high, objective: g1}}
episodes: 6
seed: {seed}
changes: [{{at: {{episode: 3}}, environment: {{blocked: [A]}}}}]
strategy: {{updates: 1}}
trigger: {{kind: window, settings: {{threshold: -3.5, discount: 1.0, steps: 4}}}}
shield: {{threshold: 0}}
"""
    without = timeless(run_loop(robot, scenario(tmp_path, text)))
    assert without["summary"]["adaptations"] > 0
    assert without["shield"]["changes"] > 0
    assert timeless(run_loop(robot, scenario(tmp_path, text, NEVER_LATE))) == without


class Slow:
    """A strategy that takes its time now and then: in making, in deciding, and in learning.

    It tries anything now and then, so that how often it was asked shows in what it does.
    """

    def __init__(self, strategy: Strategy, calls: Iterator[int], generator: np.random.Generator) -> None:
        self._strategy, self._calls, self._generator = strategy, calls, generator
        time.sleep(0.05)

    @property
    def episodes_per_update(self) -> int:
        return self._strategy.episodes_per_update

    def begin(self, observation: Observation, time: int = 0, *, resumed: bool = False) -> None:
        self._strategy.begin(observation, time, resumed=resumed)

    def act(self, allowed: Bools) -> int:
        if next(self._calls) % 5 == 0:
            time.sleep(0.025)
        if self._generator.random() < 0.3:
            return int(self._generator.choice(np.flatnonzero(allowed)))
        return self._strategy.act(allowed)

    def observe(self, action: int, observation: Observation) -> None:
        if next(self._calls) % 7 == 0:
            time.sleep(0.025)
        self._strategy.observe(action, observation)

    def update(self) -> None:
        self._strategy.update()

    def restrict(self, mask: Bools) -> None:
        assert isinstance(self._strategy, Restrictable)
        self._strategy.restrict(mask)

    def policy(self) -> Floats:
        return self._strategy.policy()

    def explain(self) -> tuple[str, ...]:
        return self._strategy.explain()


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = itertools.count()

    def make(name: str, context: StrategyContext, generator: np.random.Generator) -> Strategy:
        return Slow(make_strategy(name, context, generator), calls, generator)

    monkeypatch.setattr(managers, "make_strategy", make)


@pytest.fixture
def knowledge(tmp_path: Path) -> Iterator[KnowledgeBase]:
    with open_knowledge(f"sqlite:///{tmp_path / 'knowledge.db'}") as opened:
        yield opened


class KilledError(Exception):
    """Stands for the end of the process."""


def wrapped(system: ManagedSystem) -> ManagedSystem:
    return RetryingSystem(system, deadline=60)


def test_no_thread_is_left_over_however_a_run_ends(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    found = scenario(tmp_path, "scenario: short\nsystem: met\nepisodes: 2\n", NEVER_LATE)
    before = threading.active_count()
    with pytest.raises(KilledError):
        run_loop(run, found, knowledge=knowledge, wrap=wrapped, on_episode=killed_after(0))
    assert threading.active_count() == before
    run_loop(run, found, knowledge=knowledge, resume=True, wrap=wrapped)
    assert threading.active_count() == before
    check_decisions(run, knowledge, 1)
    assert threading.active_count() == before


def killed_after(episode: int) -> Callable[[EpisodeRow], None]:
    def stop(row: EpisodeRow) -> None:
        if row.episode == episode:
            raise KilledError

    return stop


LATE = f"""\
scenario: late
system: met
episodes: 8
changes: [{{at: {{episode: 3}}, objective: {{goal: [2, 2]}}}}]
strategy: {{updates: 1}}
sensing: {{loss: 0.1}}
noise: {{reward: 0.1, slip: 0.05}}
{NERVOUS}deadline: {{seconds: 0.01, fallback: stop}}
"""


@pytest.mark.slow
def test_a_run_in_which_decisions_were_late_is_repeated_as_it_was(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase, slow: None
) -> None:
    """The clock is another one in each process; what was late is late again all the same."""
    found = scenario(tmp_path, LATE)
    for episode in (2, 5):
        with pytest.raises(KilledError):
            run_loop(run, found, knowledge=knowledge, resume=episode > 2, on_episode=killed_after(episode))
    report = run_loop(run, found, knowledge=knowledge, resume=True)
    reasons = Counter(one.reasons[0] for one in knowledge.decisions(1) if one.kind == "fallback")
    assert set(reasons) == set(Lateness)
    assert sum(row.fallbacks for row in report.rows) == reasons.total()
    assert report.as_dict()["summary"]["adaptations"] > 0
    assert timeless(run_loop(run, found, knowledge=knowledge, resume=True)) == timeless(report)
    assert check_decisions(run, knowledge, 1) == ()
