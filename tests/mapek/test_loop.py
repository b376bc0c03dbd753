from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from merap.belief.outside import Outside
from merap.mapek.components import make_components
from merap.mapek.executor import MAX_FAULTS, Executor
from merap.mapek.loop import Components, Loop
from merap.mapek.messages import Analysis, Monitored, Plan
from merap.mapek.planner import Planner
from merap.mapek.records import EpisodeLog
from merap.mapek.run import run_loop
from merap.mdp.model import Bools
from merap.runs.run_folder import RunFolder
from merap.runs.train import train
from merap.shield.learning_shield import LearningShield, ShieldSettings, Unshielded
from merap.systems.interface import Observation
from tests.support.loop_runs import MOVED, Unsound, doubtful, hypotheses_of, scenario
from tests.support.paths import MODELS
from tests.support.shield_examples import gutter
from tests.support.trained_runs import SMALL, trained

EXAMPLE = MODELS / "running-example"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


def episodes(components: Components, count: int) -> list[EpisodeLog]:
    loop = Loop(components)
    return [loop.episode() for _ in range(count)]


def decisions(logs: list[EpisodeLog]) -> list[list[str]]:
    return [[decision.kind for decision in log.decisions] for log in logs]


@pytest.mark.slow
def test_adapt_settle_execute_notice_and_adapt_again(run: RunFolder, tmp_path: Path) -> None:
    """Three updates, then the policy is carried out until the goal is not where it was."""
    components = doubtful(run, scenario(tmp_path, MOVED.replace("episodes: 10", "episodes: 16")))
    logs = episodes(components, 16)
    assert [log.phase for log in logs[:6]] == ["adapting"] * 3 + ["executing"] * 3
    kinds = decisions(logs)
    assert kinds[:5] == [["update"], ["update"], ["update", "settled"], [], []]
    assert kinds[5][0] == "replan"
    assert logs[5].decisions[0].reasons == ("what happened was held impossible",)
    truth = components.system.truth
    assert truth is not None
    assert truth.reachable.within_5_percent(truth.value(components.learner.policy().table, components.index))


@pytest.mark.slow
@pytest.mark.parametrize("replan_from", ["meta", "adapted"])
def test_changes_amid_an_adaptation_are_come_to_terms_with(tmp_path: Path, replan_from: str) -> None:
    """The second change comes when the adaptation to the first has hardly begun. Each is noticed by the end
    of the next episode and mastered in two more."""
    run = trained(tmp_path / "run", case=EXAMPLE)
    text = """\
scenario: hasty
system: {environment: b_blocked, capability: speed_low, objective: g3}
episodes: 14
changes: [{at: {episode: 4}, environment: {blocked: [A]}}, {at: {episode: 7}, objective: g1}]
"""
    report = run_loop(run, scenario(tmp_path, text, f"strategy: {{replan_from: {replan_from}}}\n"))
    for reaction in report.reactions:
        assert reaction.replanned is not None
        assert reaction.replanned <= reaction.episode + 1
        assert reaction.episodes is not None
        assert reaction.episodes <= 3
    assert sum(row.replans for row in report.rows) == 2


def test_an_adapted_policy_is_optimal_before_the_change(run: RunFolder, tmp_path: Path) -> None:
    components = doubtful(run, scenario(tmp_path))
    logs = episodes(components, 5)
    truth = components.system.truth
    assert truth is not None
    assert truth.value(components.learner.policy().table, components.index) == pytest.approx(
        truth.reachable.optimum
    )
    last = [execution.observation for execution in logs[4].executions]
    # 8 steps at -0.5 and a stop that earns 10
    assert sum(found.reward for found in last if found is not None) == pytest.approx(6)


def test_a_manager_that_does_not_adapt_settles_at_once(run: RunFolder, tmp_path: Path) -> None:
    logs = episodes(make_components(run, scenario(tmp_path), "none"), 2)
    assert [log.phase for log in logs] == ["executing"] * 2
    assert decisions(logs) == [[], []]


@pytest.mark.parametrize("manager", ["static", "random", "reactive"])
def test_the_other_managers_never_replan(run: RunFolder, tmp_path: Path, manager: str) -> None:
    logs = episodes(make_components(run, scenario(tmp_path), manager), 7)
    assert not any(log.count("replan") for log in logs)
    assert sum(log.count("update") for log in logs) == (3 if manager == "static" else 7)


def test_a_fault_is_survived_by_the_fallback(run: RunFolder, tmp_path: Path) -> None:
    """Two calls fail amid an episode: two fallbacks, and the episode goes on."""
    components = doubtful(run, scenario(tmp_path), wrap=partial(Unsound, calls=2))
    logs = episodes(components, 3)
    faulty = logs[1]
    assert [problem.message for problem in faulty.problems] == ["dropped: the connection is lost"] * 2
    assert faulty.count("fallback") == 2
    assert faulty.executions[-1].observation is not None
    assert faulty.executions[-1].observation.last
    assert [len(log.problems) for log in logs] == [0, 2, 0]


def test_a_system_that_stays_away_costs_no_more_than_the_episode(run: RunFolder, tmp_path: Path) -> None:
    components = doubtful(run, scenario(tmp_path), wrap=partial(Unsound, calls=99))
    logs = episodes(components, 3)
    assert len(logs[1].problems) == MAX_FAULTS
    assert logs[1].executions[-1].over
    assert logs[2].problems == ()
    assert logs[2].executions[-1].observation is not None


@pytest.mark.parametrize("sensing", ["{delay: 2}", "{loss: 0.2}", "{delay: 1, loss: 0.2}"])
def test_it_adapts_though_observations_are_late_or_lost(run: RunFolder, tmp_path: Path, sensing: str) -> None:
    text = "strategy: {updates: 8}"
    found = scenario(tmp_path, more=f"sensing: {sensing}\n".replace("strategy", text))
    components = make_components(run, found, "merap")
    episodes(components, 5)
    truth = components.system.truth
    assert truth is not None
    assert truth.reachable.within_5_percent(truth.value(components.learner.policy().table, components.index))


@pytest.mark.slow
def test_a_shielded_run_has_no_violations(tmp_path: Path) -> None:
    """With A blocked the shortest way leads through the dark at B; the other is one step longer."""
    run = trained(tmp_path / "run", case=EXAMPLE)
    system = "{environment: {blocked: [A]}, capability: speed_high, objective: g1}"
    text = f"scenario: dark\nsystem: {system}\nepisodes: 6\n"
    violations = {}
    for name, shield in (("without", ""), ("with", "shield: {threshold: 0}\n")):
        report = run_loop(run, scenario(tmp_path, text, shield))
        violations[name] = report.as_dict()["summary"]["violations"]
        assert sum(row.completed for row in report.rows) >= 4
    assert violations["with"] == 0
    assert violations["without"] > 0


@pytest.mark.slow
def test_a_replanning_makes_the_shield_forget_what_it_was_sure_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what has arrived last, so that it knows where the system is."""
    run = trained(tmp_path / "run", case=EXAMPLE)
    system = "{environment: b_blocked, capability: speed_low, objective: g3, horizon: 18}"
    text = f"scenario: dark\nsystem: {system}\nepisodes: 4\nstrategy: {{updates: 2}}\n"
    more = "shield: {threshold: 0}\nchanges: [{at: {episode: 3}, objective: g1}]\n"
    components = doubtful(run, scenario(tmp_path, text, more))
    forgotten: list[Observation | None] = []
    monkeypatch.setattr(components.shield, "forget", forgotten.append)
    logs = episodes(components, 4)
    replanned = [
        log.executions[decision.step].observation
        for log in logs
        for decision in log.decisions
        if decision.kind == "replan"
    ]
    assert replanned
    assert all(found is expected for found, expected in zip(forgotten, replanned, strict=True))


class Eager(Planner):
    """Takes any action that is allowed, wherever the system is."""

    def plan(self, monitored: Monitored, analysis: Analysis, allowed: Bools) -> Plan:
        return Plan(int(self._generator.choice(np.flatnonzero(allowed))), "exploration")


@pytest.mark.slow
@pytest.mark.parametrize("sensing", ["{loss: 0.5}", "{delay: 2}"])
def test_the_threshold_holds_though_observations_are_late_or_lost(tmp_path: Path, sensing: str) -> None:
    """Whoever takes any allowed action crosses once beside the gutter, and twice once it is known to be dry.

    So an episode is violated with a probability of at most 0.19. 300 episodes at the threshold of 0.25 have
    more than 105 violations once in 20,000; with a new budget after each gap it would be 1 - 0.9^5 = 0.41.
    """
    run = train(gutter(tmp_path), tmp_path / "run", SMALL)
    text = f"scenario: late\nsystem: met\nepisodes: 300\nsensing: {sensing}\n"
    components = make_components(run, scenario(tmp_path, text), "random")
    eager = Eager(components.learner, None, components.runner, np.random.default_rng(1), {})
    space = hypotheses_of(run, components, Outside(slips=(0.05,), odds=(1.0,)))
    shield = LearningShield(space, 10, ShieldSettings(0.25))
    loop = Loop(replace(components, planner=eager, shield=shield))
    violations = steps = 0
    for _ in range(300):
        loop.episode()
        violations += bool(components.system.tally.unsafe)
        steps += components.system.tally.steps
    done = shield.report()
    assert (done.episodes, done.steps) == (300, steps)
    assert 10 < violations <= 105


class Charged(Unshielded):
    """Takes down what it is charged."""

    def __init__(self) -> None:
        self.charged: list[tuple[int, bool]] = []

    def took(self, action: int, *, surely: bool = True) -> None:
        self.charged.append((action, surely))


def test_the_shield_is_charged_what_was_executed_and_what_may_have_been(
    run: RunFolder, tmp_path: Path
) -> None:
    """In the second episode two calls fail; then a system says that it has taken another action."""
    components = doubtful(run, scenario(tmp_path), wrap=partial(Unsound, calls=2))
    shield = Charged()
    logs = episodes(replace(components, shield=shield), 2)
    executions = [one for log in logs for one in log.executions if one.action is not None]
    assert shield.charged == [(one.action, one.fault is None) for one in executions]
    assert [surely for _, surely in shield.charged].count(False) == 2
    answer = executions[0].observation
    assert answer is not None
    loop = Loop(replace(components, shield=shield, executor=Executor(Replaced(replace(answer, taken=0)))))
    loop.episode()
    assert shield.charged[-1] == (0, True)


class Replaced:
    """A system that takes its first action whatever it is asked for, and ends with it."""

    actions = ("stop", "up", "down", "left", "right")

    def __init__(self, answer: Observation) -> None:
        self.answer = answer

    def reset(self) -> Observation:
        return self.answer

    def step(self, action: int) -> Observation:
        return replace(self.answer, truncated=True)


def test_without_a_shield_everything_enabled_is_allowed() -> None:
    shield = Unshielded()
    enabled = np.array([True, False, True])
    table = np.full((4, 3), 1 / 3)
    assert shield.allowed(enabled) is enabled
    assert shield.masked(table) is table
    assert (shield.mask, shield.report()) == (None, None)
