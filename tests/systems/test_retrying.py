from __future__ import annotations

import logging
import threading
from collections.abc import Sequence

import numpy as np
import pytest

from merap.errors import InputError
from merap.systems.interface import FaultKind, Observation, SystemFault
from merap.systems.retrying import Retries, RetryingSystem
from merap.systems.simulated import SimulatedSystem
from tests.support.hand_made import grid_combination

STOP, UP, DOWN, LEFT, RIGHT = range(5)
QUICK = Retries(count=3, first_wait=0.001, longest_wait=0.002)
ONCE = Retries(count=0)


class Troubled:
    """A simulated grid whose next steps raise, or wait for the gate, before they act."""

    def __init__(self, troubles: Sequence[SystemFault | None] = (), *, hangs: int = 0) -> None:
        self.system = SimulatedSystem(grid_combination(goal=(0, 2)), 18, np.random.default_rng(0))
        self.actions = self.system.actions
        self.troubles = list(troubles)
        self.hangs = hangs
        self.gate = threading.Event()
        self.done: list[int] = []

    def reset(self) -> Observation:
        self._trouble()
        return self.system.reset()

    def step(self, action: int) -> Observation:
        self._trouble()
        self.done.append(action)
        return self.system.step(action)

    def _trouble(self) -> None:
        if self.troubles and (trouble := self.troubles.pop(0)) is not None:
            raise trouble
        if self.hangs:
            self.hangs -= 1
            assert self.gate.wait(60)


def fault(kind: FaultKind = "dropped", *, repeatable: bool = True) -> SystemFault:
    return SystemFault(kind, "for the test", repeatable=repeatable)


def begun(system: Troubled, *troubles: SystemFault | None) -> Troubled:
    """The reset succeeds, the steps have these troubles."""
    system.troubles = [None, *troubles]
    return system


def test_without_trouble_nothing_is_changed() -> None:
    guarded = RetryingSystem(Troubled(), deadline=60, retries=QUICK, fallback="stop")
    assert guarded.actions == ("stop", "up", "down", "left", "right")
    assert guarded.reset().valuation.tolist() == [0, 0, 0]
    found = [guarded.step(action) for action in (RIGHT, RIGHT, STOP)]
    assert [seen.reward for seen in found] == [-0.5, -0.5, 10]
    assert [seen.taken for seen in found] == [None] * 3


@pytest.mark.parametrize("deadline", [None, 60.0])
def test_repeatable_faults_are_mended_by_retries(
    deadline: float | None, caplog: pytest.LogCaptureFixture
) -> None:
    seen: list[SystemFault] = []
    system = begun(Troubled(), fault(), fault("timeout"), fault("malformed"))
    guarded = RetryingSystem(system, deadline=deadline, retries=QUICK, on_fault=seen.append)
    guarded.reset()
    with caplog.at_level(logging.WARNING):
        assert guarded.step(RIGHT).valuation.tolist() == [0, 1, 0]
    assert system.done == [RIGHT]
    assert [one.kind for one in seen] == ["dropped", "timeout", "malformed"]
    assert [record.getMessage() for record in caplog.records] == [
        "dropped: for the test; trying again in 0.001 s",
        "timeout: for the test; trying again in 0.002 s",
        "malformed: for the test; trying again in 0.002 s",
    ]


def test_a_reset_is_retried_too() -> None:
    guarded = RetryingSystem(Troubled([fault(), fault()]), retries=QUICK)
    assert guarded.reset().valuation.tolist() == [0, 0, 0]


def test_when_all_retries_have_failed_the_fallback_is_taken() -> None:
    system = begun(Troubled(), *[fault()] * 4)
    guarded = RetryingSystem(system, retries=QUICK, fallback="stop")
    guarded.reset()
    found = guarded.step(RIGHT)
    assert found.taken == STOP
    assert found.valuation.tolist() == [0, 0, 0]
    assert guarded.step(RIGHT).taken is None
    assert system.done == [STOP, RIGHT]


def test_a_fault_that_is_not_repeatable_is_not_retried() -> None:
    system = begun(Troubled(), fault(repeatable=False))
    guarded = RetryingSystem(system, retries=QUICK, fallback="stop")
    guarded.reset()
    assert guarded.step(RIGHT).taken == STOP
    assert system.done == [STOP]


@pytest.mark.parametrize(
    ("troubles", "fallback"),
    [
        ([fault()] * 4, None),
        ([fault()] * 5, "stop"),
        ([fault("rejected", repeatable=False)], "stop"),
        ([fault("missed", repeatable=False)], "stop"),
    ],
    ids=["no fallback", "the fallback fails too", "rejected", "missed"],
)
def test_what_no_guard_can_mend_is_raised(troubles: list[SystemFault], fallback: str | None) -> None:
    system = begun(Troubled(), *troubles)
    guarded = RetryingSystem(system, retries=QUICK, fallback=fallback)
    guarded.reset()
    with pytest.raises(SystemFault, match="for the test"):
        guarded.step(RIGHT)
    assert system.done == []
    assert guarded.reset().valuation.tolist() == [0, 0, 0]


def test_a_fallback_that_is_not_enabled_is_not_taken() -> None:
    class Disabled(Troubled):
        def reset(self) -> Observation:
            found = super().reset()
            mask = found.enabled.copy()
            mask[STOP] = False
            return Observation(found.valuation, mask, 0.0, 1.0, False)

    system = begun(Disabled(), fault(), fault())
    guarded = RetryingSystem(system, retries=ONCE, fallback="stop")
    guarded.reset()
    with pytest.raises(SystemFault, match="for the test"):
        guarded.step(RIGHT)
    assert system.done == []


def test_a_late_step_is_waited_for_again_and_not_made_twice() -> None:
    system = Troubled()
    guarded = RetryingSystem(system, deadline=0.05, retries=Retries(1000, 0.001, 0.01))
    guarded.reset()
    system.hangs = 1
    threading.Timer(0.3, system.gate.set).start()
    assert guarded.step(RIGHT).valuation.tolist() == [0, 1, 0]
    assert system.done == [RIGHT]


def test_a_system_that_hangs_ends_in_a_timeout_and_can_be_reset_when_it_is_back() -> None:
    system = Troubled()
    guarded = RetryingSystem(system, deadline=0.05, retries=ONCE, fallback="stop")
    guarded.reset()
    system.hangs = 1
    with pytest.raises(SystemFault, match=r"has not answered within 0\.05 s") as caught:
        guarded.step(RIGHT)
    assert caught.value.kind == "timeout"
    system.gate.set()
    patient = RetryingSystem(system, deadline=60)
    assert patient.reset().valuation.tolist() == [0, 0, 0]
    assert system.done in ([], [RIGHT])  # the step may still be under way


def test_a_step_that_arrives_while_the_fallback_is_tried_is_the_one_that_was_asked_for() -> None:
    """The fallback is not made in addition to a step that was only late."""
    system = Troubled()

    def open_gate(_: SystemFault) -> None:
        system.gate.set()

    guarded = RetryingSystem(system, deadline=1.0, retries=ONCE, fallback="stop", on_fault=open_gate)
    guarded.reset()
    system.hangs = 1
    found = guarded.step(RIGHT)
    assert found.taken is None
    assert found.valuation.tolist() == [0, 1, 0]
    assert system.done == [RIGHT]


class LateFault(Troubled):
    """Its first step fails, but late: once the gate is open; the steps after it have other troubles."""

    def __init__(self, late: SystemFault, after: SystemFault | None = None) -> None:
        super().__init__()
        self.late: list[SystemFault | None] = [late, after]

    def step(self, action: int) -> Observation:
        assert self.gate.wait(60)
        if self.late and (trouble := self.late.pop(0)) is not None:
            raise trouble
        return super().step(action)

    def open_gate(self, _: SystemFault) -> None:
        self.gate.set()


def waiting_for(system: LateFault) -> RetryingSystem:
    """The first step is late, and has its outcome while it is waited for again."""
    return RetryingSystem(system, deadline=1.0, retries=ONCE, fallback="stop", on_fault=system.open_gate)


def test_a_step_that_is_late_and_then_fails_is_replaced_by_the_fallback() -> None:
    system = LateFault(fault("failed"))
    with waiting_for(system) as guarded:
        guarded.reset()
        assert guarded.step(RIGHT).taken == STOP
    assert system.done == [STOP]


@pytest.mark.parametrize(
    ("late", "after"),
    [
        (fault("failed"), fault("dropped")),
        (fault("rejected", repeatable=False), None),
        (fault("missed", repeatable=False), None),
    ],
    ids=["the fallback fails too", "rejected", "missed"],
)
def test_a_step_that_is_late_is_replaced_no_more_than_any_other(
    late: SystemFault, after: SystemFault | None
) -> None:
    system = LateFault(late, after)
    with waiting_for(system) as guarded:
        guarded.reset()
        with pytest.raises(SystemFault) as caught:
            guarded.step(RIGHT)
    assert caught.value is (late if after is None else after)
    assert system.done == []


def test_a_guard_that_is_closed_leaves_no_thread() -> None:
    before = threading.active_count()
    with RetryingSystem(Troubled(), deadline=60) as guarded:
        guarded.reset()
        assert threading.active_count() == before + 1
    assert threading.active_count() == before
    with RetryingSystem(Troubled()) as plain:
        plain.reset()
        assert threading.active_count() == before


def test_errors_that_are_no_faults_pass() -> None:
    for deadline in (None, 60.0):
        with RetryingSystem(Troubled(), deadline=deadline, retries=QUICK, fallback="stop") as guarded:
            guarded.reset()
            with pytest.raises(InputError, match="action 7 is not enabled"):
                guarded.step(7)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"deadline": 0}, "a deadline is a positive number"),
        ({"deadline": float("nan")}, "a deadline is a positive number"),
        ({"fallback": "flee"}, "no action 'flee' to fall back on; allowed: stop, up, down, left, right"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RetryingSystem(Troubled(), **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize("arguments", [(-1, 0.1, 1.0), (1, -0.1, 1.0), (1, 2.0, 1.0), (1, 0.1, float("inf"))])
def test_retries_that_make_no_sense_are_refused(arguments: tuple[int, float, float]) -> None:
    with pytest.raises(InputError, match="retries are a number from 0 on"):
        Retries(*arguments)
