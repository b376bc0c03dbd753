"""Count the steps of a managed system and carry out requests, without any HTTP.

One request is carried out after the other. The system waits for its manager, or goes at a pace of its own.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

import numpy as np
from jsonschema import Draft202012Validator

from merap.errors import InputError, MerapError, shortened
from merap.systems.description import Interface, Json, execute_schema, require_declared
from merap.systems.interface import ManagedSystem, Observation

MAX_MESSAGE = 500
log = logging.getLogger(__name__)


class RefusedRequestError(MerapError):
    """Raised for a request that is not carried out.

    Args:
        status: status of HTTP: BAD_REQUEST if it never can be, CONFLICT if it can't be now.
        message: why not, and which requests can.
    """

    def __init__(self, status: HTTPStatus, message: str) -> None:
        self.status = status
        super().__init__(" ".join(message.split()))


@dataclass(frozen=True)
class _Command:
    """A change and the counters at which it was decided.

    Attributes:
        action: name; None: a reset.
        decided: episode and step then.
    """

    action: str | None
    decided: tuple[int, int]


def _check_pace(pace: Pace, actions: tuple[str, ...]) -> None:
    if not 0 < pace.seconds < math.inf:
        raise InputError(f"a deadline is a positive number of seconds, not {pace.seconds}")
    if pace.fallback not in actions:
        allowed = ", ".join(actions)
        raise InputError(f"there is no action {pace.fallback!r} to fall back on; allowed: {allowed}")


def _bad_request(message: str) -> RefusedRequestError:
    return RefusedRequestError(HTTPStatus.BAD_REQUEST, shortened(message, MAX_MESSAGE))


@dataclass(frozen=True)
class Pace:
    """A system that does not wait for its manager.

    Attributes:
        seconds: for a decision, from one step to the next.
        fallback: name of the action that the system takes when there is none in time.
    """

    seconds: float
    fallback: str


class ServedSystem:
    """Monitors and executes; begins with its first episode.

    A request that carries the counters at which it was decided is carried out once, however often it is sent.

    Args:
        system: the managed system.
        interface: how it is shown.
        pace: None: it waits. Where the fallback is not enabled, and when the episode is over, it waits too.
        clock: seconds, never going back.

    Raises:
        InputError: the system has other actions than the interface or can't be reset, or the pace is none.
    """

    def __init__(
        self,
        system: ManagedSystem,
        interface: Interface,
        *,
        pace: Pace | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if system.actions != interface.actions:
            raise InputError(f"the system has the actions {system.actions}, not {interface.actions}")
        if pace is not None:
            _check_pace(pace, interface.actions)
        self._pace, self._clock = pace, clock
        self._since = clock()
        self.interface = interface
        self._system = system
        self._validator = Draft202012Validator(execute_schema(interface))
        self._last: _Command | None = None
        self._episode = 0
        self._reset()

    def monitor(self) -> Json:
        """Show the observation now; see `description.monitor_schema`."""
        self._catch_up()
        seen = self._seen
        valued = zip(self.interface.variables, seen.valuation.tolist(), strict=True)
        return {
            "valuation": {one.name: bool(value) if one.boolean else value for one, value in valued},
            "enabled": [self.interface.actions[index] for index in np.flatnonzero(seen.enabled)],
            "reward": float(seen.reward),
            "continuation": float(seen.continuation),
            "truncated": bool(seen.truncated),
            "detections": {name: dict(self._readings(name)) for name in self.interface.detectors},
            "action": self._action,
            "total": self._total,
            **self._counters(),
        }

    def execute(self, request: Any) -> Json:
        """Take an action or begin an episode; see `description.execute_schema`.

        Returns:
            The change, with the counters after it.

        Raises:
            RefusedRequestError: the request is malformed or not possible now; nothing has happened.
        """
        self._catch_up()
        command = self._command(request)
        if command.decided != self._now():
            self._require_repeated(command)
        elif command.action is None:
            self._reset()
            self._last = command
        else:
            self._step(command.action)
            self._last = command
        return {"action": command.action, "reset": command.action is None, **self._counters()}

    def _command(self, request: Any) -> _Command:
        error = next(iter(self._validator.iter_errors(request)), None)
        if error is not None:
            place = "".join(f" in {key!r}" for key in error.path)
            raise _bad_request(f"the body is not as asked{place}: {error.message}")
        action, reset = request.get("action"), request.get("reset", False)
        if (action is not None) == reset:
            names = ", ".join(self.interface.actions)
            raise _bad_request(f'give an action, or "reset": true, not both; actions are {names}')
        given = [key for key in ("episode", "step") if key in request]
        if len(given) == 1:
            raise _bad_request(f"{given[0]} alone: give episode and step, or neither")
        decided = (request["episode"], request["step"]) if given else self._now()
        return _Command(action, decided)

    def _require_repeated(self, command: _Command) -> None:
        if command != self._last:
            episode, step = self._now()
            raise RefusedRequestError(
                HTTPStatus.CONFLICT,
                f"decided at episode {command.decided[0]}, step {command.decided[1]}, but the system is at "
                f"episode {episode}, step {step}",
            )

    def _catch_up(self) -> None:
        """Take the fallbacks of all deadlines that have passed; nobody could see them before."""
        pace = self._pace
        while pace is not None and self._clock() - self._since >= pace.seconds and self._can(pace.fallback):
            log.warning("no decision within %g s; the system takes %s", pace.seconds, pace.fallback)
            due = self._since + pace.seconds
            self._step(pace.fallback)
            self._since, self._last = due, None

    def _can(self, action: str) -> bool:
        return not self._seen.last and bool(self._seen.enabled[self.interface.actions.index(action)])

    def _reset(self) -> None:
        self._seen = self._declared(self._system.reset())
        self._since = self._clock()
        self._episode += 1
        self._steps, self._total = 0, 0.0
        self._action: str | None = None

    def _step(self, action: str) -> None:
        if self._seen.last:
            raise RefusedRequestError(
                HTTPStatus.CONFLICT, 'the episode is over; execute {"reset": true} first'
            )
        index = self.interface.actions.index(action)
        if not self._seen.enabled[index]:
            enabled = [self.interface.actions[number] for number in np.flatnonzero(self._seen.enabled)]
            raise RefusedRequestError(
                HTTPStatus.CONFLICT, f"action {action!r} is not enabled now; enabled are {', '.join(enabled)}"
            )
        self._seen = self._declared(self._system.step(index))
        self._since = self._clock()
        self._steps += 1
        self._total += float(self._seen.reward)
        self._action = action

    def _declared(self, seen: Observation) -> Observation:
        require_declared(seen, self.interface)
        return seen

    def _now(self) -> tuple[int, int]:
        return self._episode, self._steps

    def _counters(self) -> Json:
        return {"episode": self._episode, "step": self._steps}

    def _readings(self, detector: str) -> Mapping[str, Any]:
        readings = self._seen.detections.get(detector, {})
        assert isinstance(readings, Mapping)
        return readings
