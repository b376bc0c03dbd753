"""Call a system again that is late or fails, or fall back on a safe action; see `deadline` for a planner.

Axes: A declared actions.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial

import tenacity

from merap.errors import InputError
from merap.systems.interface import ManagedSystem, Observation, SystemFault
from merap.systems.worker import Worker

log = logging.getLogger(__name__)

# After these no other action is to be taken: the system has said no, or has gone on.
FINAL = frozenset({"rejected", "missed"})
FaultListener = Callable[[SystemFault], None]


@dataclass(frozen=True)
class Retries:
    """Bounds on how often, and how soon, a call that failed is made again.

    Attributes:
        count: at most.
        first_wait: seconds before the first; doubles with each.
        longest_wait: seconds.
    """

    count: int = 3
    first_wait: float = 0.1
    longest_wait: float = 2.0

    def __post_init__(self) -> None:
        if self.count < 0 or not 0 <= self.first_wait <= self.longest_wait < math.inf:
            raise InputError(f"retries are a number from 0 on, with waits that grow, not {self}")


class RetryingSystem(AbstractContextManager["RetryingSystem"]):
    """Add a deadline, retries and a safe fallback action to any system; a context, which closes it.

    A call is made again after a fault that is repeatable. A call that is late is never made a second
    time: it is waited for again. When an action has failed for good and the fallback is enabled, the
    fallback is taken, once. An action that is late then is waited for once more: only if it fails the
    fallback is taken. `taken` of the observation tells what the system has done. If the fallback fails too,
    there is none, or the action stays late, the fault is raised, and the system can be reset.

    Args:
        system: the managed system.
        deadline: seconds for a call; None: as long as it takes.
        retries: after faults.
        fallback: name of a safe action; None: there is none.
        on_fault: called with every fault, also one that a retry has mended.

    Raises:
        InputError: the deadline is no positive number, or there is no such action.
    """

    def __init__(
        self,
        system: ManagedSystem,
        *,
        deadline: float | None = None,
        retries: Retries | None = None,
        fallback: str | None = None,
        on_fault: FaultListener = lambda _: None,
    ) -> None:
        if deadline is not None and not deadline > 0:
            raise InputError(f"a deadline is a positive number of seconds, not {deadline}")
        if fallback is not None and fallback not in system.actions:
            raise InputError(
                f"there is no action {fallback!r} to fall back on; allowed: {', '.join(system.actions)}"
            )
        self._system = system
        self._deadline = deadline
        self._retries = retries or Retries()
        self._fallback = None if fallback is None else system.actions.index(fallback)
        self._on_fault = on_fault
        self._worker = Worker("managed system") if deadline is not None else None
        self._late: Future[Observation] | None = None
        self._last: Observation | None = None

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread that keeps the deadline; a call that hangs is left to itself."""
        if self._worker is not None:
            self._worker.close()

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._system.actions

    def reset(self) -> Observation:
        """Begin an episode.

        Raises:
            SystemFault: all attempts have failed.
        """
        # A step that is still under way ends before the reset; what it leads to is not wanted any more.
        self._late = None
        self._last = self._repeated(self._system.reset)
        return self._last

    def step(self, action: int) -> Observation:
        """Take an action, or else the fallback.

        Raises:
            SystemFault: all attempts have failed, and so has the fallback.
        """
        try:
            observation = self._repeated(partial(self._system.step, action))
        except SystemFault as fault:
            observation = self._fallen_back(action, fault)
        self._last = observation
        return observation

    def _fallen_back(self, action: int, fault: SystemFault) -> Observation:
        fallback = self._fallback
        if fallback is None or fault.kind in FINAL or not self._possible(fallback):
            raise fault
        if self._is_late():
            try:
                return self._attempt(partial(self._system.step, action))
            except SystemFault as failed:
                if self._is_late() or failed.kind in FINAL:
                    raise
                fault = failed
        log.warning("%s; falling back on %s", fault, self.actions[fallback])
        observation = self._attempt(partial(self._system.step, fallback))
        done = fallback if observation.taken is None else observation.taken
        return replace(observation, taken=None if done == action else done)

    def _is_late(self) -> bool:
        return self._late is not None

    def _possible(self, action: int) -> bool:
        return self._last is not None and bool(self._last.enabled[action])

    def _repeated(self, call: Callable[[], Observation]) -> Observation:
        attempts = tenacity.Retrying(
            stop=tenacity.stop_after_attempt(1 + self._retries.count),
            wait=tenacity.wait_exponential(self._retries.first_wait, max=self._retries.longest_wait),
            retry=tenacity.retry_if_exception(_repeatable),
            before_sleep=_tell_retry,
            reraise=True,
        )
        return attempts(self._attempt, call)

    def _attempt(self, call: Callable[[], Observation]) -> Observation:
        try:
            return call() if self._worker is None else self._in_time(self._worker, call)
        except SystemFault as fault:
            self._on_fault(fault)
            raise

    def _in_time(self, worker: Worker, call: Callable[[], Observation]) -> Observation:
        """Wait for the call that is late, if there is one, else make this one."""
        future = self._late or worker.submit(call)
        answered, _ = wait([future], self._deadline)
        self._late = None if answered else future
        if not answered:
            raise SystemFault("timeout", f"the system has not answered within {self._deadline:g} s")
        return future.result()


def _repeatable(error: BaseException) -> bool:
    return isinstance(error, SystemFault) and error.repeatable


def _tell_retry(state: tenacity.RetryCallState) -> None:
    assert state.outcome is not None
    assert state.next_action is not None
    log.warning("%s; trying again in %.3g s", state.outcome.exception(), state.next_action.sleep)
