from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest

from merap.errors import MerapError
from merap.mapek.executor import MAX_FAULTS, Executor
from merap.mapek.messages import Plan
from merap.systems.interface import Observation
from tests.support.loop_examples import seen

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
    executor = Executor(system)
    assert executor.reset().action is None
    execution = executor.execute(PLAN)
    assert execution.observation is not None
    assert (execution.action, execution.fault, execution.over) == (4, None, False)
    assert system.taken == [4]


def test_a_fault_is_reported_and_the_episode_goes_on() -> None:
    executor = Executor(Scripted(seen(0, 0), "no answer", seen(0, 1), "no answer", seen(0, 2)))
    executor.reset()
    found = [executor.execute(PLAN) for _ in range(4)]
    assert [execution.fault for execution in found] == ["no answer", None, "no answer", None]
    assert not any(execution.over for execution in found)


def test_after_faults_in_a_row_the_episode_is_given_up() -> None:
    executor = Executor(Scripted(seen(0, 0), *["no answer"] * MAX_FAULTS, seen(0, 0), "no answer"))
    executor.reset()
    over = [executor.execute(PLAN).over for _ in range(MAX_FAULTS)]
    assert over == [False] * (MAX_FAULTS - 1) + [True]
    executor.reset()
    assert not executor.execute(PLAN).over


def test_an_episode_that_can_not_begin_is_over() -> None:
    execution = Executor(Scripted("connection refused")).reset()
    assert (execution.observation, execution.fault, execution.over) == (None, "connection refused", True)


@pytest.mark.parametrize(
    ("rubbish", "complaint"),
    [
        (seen(0, 1, math.nan), "the system reports the reward nan, expected a finite number"),
        (seen(0, 1, enabled=(True,) * 3), "the system says of 3 actions whether they are enabled, not of 5"),
        (seen(0, 1, enabled=(False,) * 5), "the system has no action that is enabled, though"),
    ],
)
def test_rubbish_is_a_fault(rubbish: Observation, complaint: str) -> None:
    executor = Executor(Scripted(seen(0, 0), rubbish))
    executor.reset()
    fault = executor.execute(PLAN).fault
    assert fault is not None
    assert fault.startswith(complaint)


def test_what_a_guarded_system_has_taken_in_its_place_is_what_was_done() -> None:
    """A fallback, for instance: the analyzer must not take it for the planned action."""
    wrapped = Scripted(replace(seen(0, 0), taken=0), seen(0, 0))
    executor = Executor(wrapped)
    assert executor.execute(PLAN).action == 0
    assert executor.execute(PLAN).action == PLAN.action
