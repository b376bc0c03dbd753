from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from merap.errors import MerapError
from merap.mdp.model import Bools
from merap.online.loop.executor import MAX_FAULTS, Executor
from merap.online.loop.messages import Analysis, Plan, Sighting, Transition
from merap.online.shield.shield import ShieldReport
from merap.online.systems import Observation
from tests.loop_examples import NUM_ACTIONS, monitored, seen

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


class Strict:
    """A shield that forbids an action in each state: that with the state's number."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def begin(self, state: int) -> None:
        self.calls.append(f"begin {state}")

    def allowed(self, state: int, enabled: Bools) -> Bools:
        mask: Bools = enabled & (np.arange(NUM_ACTIONS) != state)
        return mask

    def took(self, action: int, state: int) -> None:
        self.calls.append(f"{action} to {state}")

    def refresh(self) -> None:
        self.calls.append("refresh")

    def report(self) -> ShieldReport:
        return ShieldReport(threshold=0.0)


def whereabouts(**probability: float) -> Analysis:
    where = np.zeros(82)
    for name, mass in probability.items():
        where[int(name[1:])] = mass
    return Analysis("executing", where)


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
    assert executor.allowed(monitored(3), whereabouts(s3=1.0)).all()


def test_the_shield_is_told_what_was_seen_and_masks_what_is_enabled() -> None:
    shield = Strict()
    executor = Executor(Scripted(seen(0, 0)), shield)
    executor.reset()
    mask = executor.allowed(monitored(0, [Sighting(0, seen(0, 0))]), whereabouts(s0=1.0))
    assert mask.tolist() == [False, True, True, True, True]
    mask = executor.allowed(monitored(1, [Transition(0, 0, 4, 1, seen(0, 1))]), whereabouts(s1=1.0))
    assert mask.tolist() == [True, False, True, True, True]
    executor.end(monitored(2, [Transition(0, 1, 4, 2, seen(0, 2))], last=True))
    assert [call for call in shield.calls if call != "refresh"] == ["begin 0", "4 to 1", "4 to 2"]


def test_where_the_state_is_not_seen_all_probable_ones_must_allow_it() -> None:
    executor = Executor(Scripted(seen(0, 0)), Strict())
    executor.reset()
    mask = executor.allowed(monitored(None), whereabouts(s1=0.5, s2=0.495, s3=0.005))
    assert mask.tolist() == [True, False, False, True, True]


def test_the_mask_is_never_empty() -> None:
    executor = Executor(Scripted(seen(0, 0)), Strict())
    executor.reset()
    mask = executor.allowed(monitored(None), whereabouts(**{f"s{state}": 0.2 for state in range(5)}))
    assert mask.tolist() == [False, False, False, False, True]


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
