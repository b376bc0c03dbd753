"""Manage a system behind HTTP like any other.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

import logging
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Self

from merap.errors import InputError
from merap.systems.dialect import Dialect, MonitoredState
from merap.systems.http_client import UpisasClient
from merap.systems.interface import Observation, SystemFault

log = logging.getLogger(__name__)


class HttpSystem(AbstractContextManager["HttpSystem"]):
    """A system behind HTTP; to be closed, or used in a `with` statement.

    A call that ended in a repeatable fault may be made again. Where the system counts its steps it
    never acts twice; where it does not, a request is not sent again once it has been answered, and a fault
    is not repeatable where the system may have acted without an answer.

    Args:
        client: speaks to its endpoints.
        dialect: the meaning of its JSON.
    """

    def __init__(self, client: UpisasClient, dialect: Dialect) -> None:
        self._client = client
        self._dialect = dialect
        self._last: MonitoredState | None = None
        self._answered: int | _Nothing | None = NOTHING

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self._dialect.actions

    def reset(self) -> Observation:
        """Begin an episode.

        Raises:
            SystemFault: the system can't be reached or does not behave.
        """
        if self._last is None:
            # Only a request that carries counters can be repeated safely.
            self._last = self._monitor()
        self._execute(None)
        seen = self._monitor()
        if seen.step not in {None, 0}:
            raise self._missed(f"after a reset it is at step {seen.step} already")
        self._settle(seen)
        return seen.observation

    def step(self, action: int) -> Observation:
        """Take an action; `taken` of the observation tells if the system has taken another one.

        Raises:
            InputError: there is no such action, or no episode has begun.
            SystemFault: the system can't be reached or does not behave; `rejected`: the action is not
                enabled or the episode over, nothing has happened.
        """
        if self._last is None:
            raise InputError("the episode has not begun; reset the system first")
        if not 0 <= action < len(self.actions):
            raise InputError(f"there is no action {action}, only 0 to {len(self.actions) - 1}")
        refusal = self._execute(action)
        seen = self._monitor()
        self._require_next(seen, refusal)
        self._settle(seen)
        taken = None if seen.action in {None, action} else seen.action
        return replace(seen.observation, taken=taken)

    def _execute(self, action: int | None) -> SystemFault | None:
        """Send a change unless it is known to have arrived; return why it was refused."""
        if self._answered == action:
            return None
        change = self._dialect.change(action, self._last)
        if change is None:
            return None
        try:
            self._client.execute(change)
        except SystemFault as fault:
            if fault.kind == "rejected":
                return self._refused(action, fault)
            counted = self._last is not None and self._last.step is not None
            if counted or fault.kind == "refused":
                raise
            raise SystemFault(fault.kind, fault.message, repeatable=False) from fault
        self._answered = action
        return None

    def _refused(self, action: int | None, fault: SystemFault) -> SystemFault:
        """Raise a refusal, unless the system may have gone on since: the monitor tells what it has done."""
        if action is None:
            self._last = None
            raise fault
        if self._last is None or self._last.step is None:
            raise fault
        return fault

    def _require_next(self, seen: MonitoredState, refusal: SystemFault | None) -> None:
        """Refuse a step that is not the one after the last."""
        last = self._last
        assert last is not None
        if last.step is None or seen.step is None:
            return
        if refusal is not None and (seen.episode, seen.step) == (last.episode, last.step):
            raise refusal
        if (seen.episode, seen.step) != (last.episode, last.step + 1):
            raise self._missed(
                f"expected step {last.step + 1} of episode {last.episode}, it is at step {seen.step} of "
                f"episode {seen.episode}: it has gone on by itself, or has another manager too"
            )
        if refusal is not None:
            log.warning("%s; it has gone on by %s", refusal, self._name(seen.action))

    def _missed(self, message: str) -> SystemFault:
        """Build the fault after which only a reset can go on."""
        self._last, self._answered = None, NOTHING
        return SystemFault("missed", f"{self._client.url}: {message}", repeatable=False)

    def _name(self, action: int | None) -> str:
        return "an unknown action" if action is None else self.actions[action]

    def _settle(self, seen: MonitoredState) -> None:
        self._last = seen
        self._answered = NOTHING

    def _monitor(self) -> MonitoredState:
        monitored = self._client.monitor()
        try:
            return self._dialect.read(monitored)
        except (ValueError, KeyError, TypeError) as error:
            raise self._client.fault("malformed", "GET /monitor", str(error)) from error


class _Nothing:
    """No change is under way; None would be a reset."""


NOTHING = _Nothing()
