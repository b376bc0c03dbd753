from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from merap.belief.space import hypothesis_space
from merap.errors import MerapError
from merap.mapek.executor import MAX_FAULTS, Executor
from merap.mapek.loop_shield import LoopShield
from merap.mapek.messages import Plan
from merap.shield.learning_shield import ShieldSettings
from merap.systems.interface import Observation
from tests.support.loop_examples import NUM_ACTIONS, monitored, seen
from tests.support.shield_examples import gutter

PLAN = Plan(4, "policy")


class Scripted:
    """A system that answers, or faults, as a script says."""

    def __init__(self, *answers: Observation | str) -> None:
        self.answers: Iterator[Observation | str] = iter(answers)
        self.taken: list[int] = []

    @property
    def actions(self) -> tuple[str, ...]:
        return ("stop", "up", "down", "left", "right")

    def reset(self) -> Observation:
        return self._answer()

    def step(self, action: int) -> Observation:
        self.taken.append(action)
        return self._answer()

    def _answer(self) -> Observation:
        answer = next(self.answers)
        if isinstance(answer, str):
            raise MerapError(answer)
        return answer


def test_what_is_planned_is_done() -> None:
    system = Scripted(seen(0, 0), seen(0, 1))
    executor = Executor(system, None)
    assert executor.reset().action is None
    execution = executor.execute(PLAN)
    assert execution.observation is not None
    assert (execution.action, execution.fault, execution.over) == (4, None, False)
    assert system.taken == [4]


def test_a_fault_is_reported_and_the_episode_goes_on() -> None:
    executor = Executor(Scripted(seen(0, 0), "no answer", seen(0, 1), "no answer", seen(0, 2)), None)
    executor.reset()
    found = [executor.execute(PLAN) for _ in range(4)]
    assert [execution.fault for execution in found] == ["no answer", None, "no answer", None]
    assert not any(execution.over for execution in found)


def test_after_faults_in_a_row_the_episode_is_given_up() -> None:
    executor = Executor(Scripted(seen(0, 0), *["no answer"] * MAX_FAULTS, seen(0, 0), "no answer"), None)
    executor.reset()
    over = [executor.execute(PLAN).over for _ in range(MAX_FAULTS)]
    assert over == [False] * (MAX_FAULTS - 1) + [True]
    executor.reset()
    assert not executor.execute(PLAN).over


def test_an_episode_that_can_not_begin_is_over() -> None:
    execution = Executor(Scripted("connection refused"), None).reset()
    assert (execution.observation, execution.fault, execution.over) == (None, "connection refused", True)


def test_without_a_shield_everything_enabled_is_allowed() -> None:
    executor = Executor(Scripted(), None)
    assert executor.allowed(monitored(3)).all()
    assert executor.mask() is None
    table = np.full((82, NUM_ACTIONS), 1 / NUM_ACTIONS)
    assert executor.carried_out(table) is table


@pytest.mark.parametrize(
    ("rubbish", "complaint"),
    [
        (seen(0, 1, math.nan), "the system reports the reward nan, expected a finite number"),
        (seen(0, 1, enabled=(True,) * 3), "the system says of 3 actions whether they are enabled, not of 5"),
        (seen(0, 1, enabled=(False,) * 5), "the system has no action that is enabled, though"),
    ],
)
def test_rubbish_is_a_fault(rubbish: Observation, complaint: str) -> None:
    executor = Executor(Scripted(seen(0, 0), rubbish), None)
    executor.reset()
    fault = executor.execute(PLAN).fault
    assert fault is not None
    assert fault.startswith(complaint)


def test_what_a_guarded_system_has_taken_in_its_place_is_what_was_done() -> None:
    """A fallback, for instance: the analyzer must not take it for the planned action."""
    guarded = Scripted(replace(seen(0, 0), taken=0), seen(0, 0))
    executor = Executor(guarded, None)
    assert executor.execute(PLAN).action == 0
    assert executor.execute(PLAN).action == PLAN.action


def test_the_shield_is_told_what_was_executed_and_what_may_have_been(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[int, bool]] = []
    space = hypothesis_space(gutter(tmp_path))
    shield = LoopShield(space, 10, ShieldSettings(0.0))
    monkeypatch.setattr(shield, "took", lambda action, *, surely: told.append((action, surely)))
    executor = Executor(Scripted(seen(0, 0), seen(0, 1), replace(seen(0, 1), taken=0), "no answer"), shield)
    executor.reset()
    for _ in range(3):
        executor.execute(PLAN)
    assert told == [(4, True), (0, True), (4, False)]
