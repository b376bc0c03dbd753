from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from merap.belief.outside import Outside
from merap.belief.space import hypothesis_space
from merap.learning.run_folder import RunFolder
from merap.learning.running import train
from merap.mapek.components import Built, build
from merap.mapek.executor import MAX_FAULTS, Executor
from merap.mapek.loop import Loop
from merap.mapek.loop_shield import LoopShield
from merap.mapek.messages import Analysis, Monitored, Plan
from merap.mapek.planner import Planner
from merap.mapek.records import EpisodeLog
from merap.mapek.run import run_loop
from merap.mdp.model import Bools
from merap.shield.learning_shield import ShieldSettings
from tests.support.loop_runs import MOVED, Unsound, doubtful, scenario
from tests.support.paths import MODELS
from tests.support.shield_examples import gutter
from tests.support.trained_runs import SMALL, trained

EXAMPLE = MODELS / "running-example"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return trained(tmp_path_factory.mktemp("runs") / "run")


def episodes(built: Built, count: int) -> list[EpisodeLog]:
    loop = Loop(built.parts, adapts=built.adapts)
    return [loop.episode() for _ in range(count)]


def decisions(logs: list[EpisodeLog]) -> list[list[str]]:
    return [[decision.kind for decision in log.decisions] for log in logs]


@pytest.mark.slow
def test_adapt_settle_execute_notice_and_adapt_again(run: RunFolder, tmp_path: Path) -> None:
    """Three updates, then the policy is carried out until the goal is not where it was."""
    built = doubtful(run, scenario(tmp_path, MOVED.replace("episodes: 10", "episodes: 16")))
    logs = episodes(built, 16)
    assert [log.phase for log in logs[:6]] == ["adapting"] * 3 + ["executing"] * 3
    kinds = decisions(logs)
    assert kinds[:5] == [["update"], ["update"], ["update", "settled"], [], []]
    assert kinds[5][0] == "replan"
    assert logs[5].decisions[0].reasons == ("what happened was held impossible",)
    truth = built.system.truth
    assert truth is not None
    assert truth.reachable.within_5_percent(truth.value(built.parts.learner.policy().table))


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
    built = doubtful(run, scenario(tmp_path))
    logs = episodes(built, 5)
    truth = built.system.truth
    assert truth is not None
    assert truth.value(built.parts.learner.policy().table) == pytest.approx(truth.reachable.optimum)
    last = [execution.observation for execution in logs[4].executions]
    # 8 steps at -0.5 and a stop that earns 10
    assert sum(found.reward for found in last if found is not None) == pytest.approx(6)


def test_a_manager_that_does_not_adapt_settles_at_once(run: RunFolder, tmp_path: Path) -> None:
    logs = episodes(build(run, scenario(tmp_path), "none"), 2)
    assert [log.phase for log in logs] == ["executing"] * 2
    assert decisions(logs) == [[], []]


@pytest.mark.parametrize("manager", ["static", "random", "reactive"])
def test_the_other_managers_never_replan(run: RunFolder, tmp_path: Path, manager: str) -> None:
    logs = episodes(build(run, scenario(tmp_path), manager), 7)
    assert not any(log.count("replan") for log in logs)
    assert sum(log.count("update") for log in logs) == (3 if manager == "static" else 7)


def test_a_fault_is_survived_by_the_fallback(run: RunFolder, tmp_path: Path) -> None:
    """Two calls fail amid an episode: two fallbacks, and the episode goes on."""
    built = doubtful(run, scenario(tmp_path), guard=partial(Unsound, calls=2))
    logs = episodes(built, 3)
    faulty = logs[1]
    assert [problem.message for problem in faulty.problems] == ["dropped: the connection is lost"] * 2
    assert faulty.count("fallback") == 2
    assert faulty.executions[-1].observation is not None
    assert faulty.executions[-1].observation.last
    assert [len(log.problems) for log in logs] == [0, 2, 0]


def test_a_system_that_stays_away_costs_no_more_than_the_episode(run: RunFolder, tmp_path: Path) -> None:
    built = doubtful(run, scenario(tmp_path), guard=partial(Unsound, calls=99))
    logs = episodes(built, 3)
    assert len(logs[1].problems) == MAX_FAULTS
    assert logs[1].executions[-1].over
    assert logs[2].problems == ()
    assert logs[2].executions[-1].observation is not None


@pytest.mark.parametrize("sensing", ["{delay: 2}", "{loss: 0.2}", "{delay: 1, loss: 0.2}"])
def test_it_adapts_though_observations_are_late_or_lost(run: RunFolder, tmp_path: Path, sensing: str) -> None:
    text = "strategy: {updates: 8}"
    found = scenario(tmp_path, more=f"sensing: {sensing}\n".replace("strategy", text))
    built = build(run, found, "merap")
    episodes(built, 5)
    truth = built.system.truth
    assert truth is not None
    assert truth.reachable.within_5_percent(truth.value(built.parts.learner.policy().table))


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
    built = doubtful(run, scenario(tmp_path, text, more))
    assert built.shield is not None
    forgotten: list[Monitored] = []
    monkeypatch.setattr(built.shield, "forget", forgotten.append)
    logs = episodes(built, 4)
    replanned = [decision.step for log in logs for decision in log.decisions if decision.kind == "replan"]
    assert [one.step for one in forgotten] == replanned
    assert replanned


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
    built = build(run, scenario(tmp_path, text), "random")
    eager = Eager(built.parts.learner, None, built.parts.punctual, np.random.default_rng(1), {})
    space = hypothesis_space(run.case, Outside(slips=(0.05,), odds=(1.0,)))
    shield = LoopShield(space, 10, ShieldSettings(0.25))
    loop = Loop(replace(built.parts, planner=eager, executor=Executor(built.system, shield)))
    violations = steps = 0
    for _ in range(300):
        loop.episode()
        violations += bool(built.system.tally.unsafe)
        steps += built.system.tally.steps
    done = shield.as_dict()
    assert (done["episodes"], done["steps"]) == (300, steps)
    assert 10 < violations <= 105
