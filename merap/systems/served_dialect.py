"""Manage what `merap serve` offers.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from merap.errors import InputError
from merap.systems.description import Interface, Json, read_interface
from merap.systems.dialect import Seen
from merap.systems.faults import SystemFault
from merap.systems.http_client import UpisasClient
from merap.systems.http_system import HttpSystem
from merap.systems.interface import Observation


@dataclass(frozen=True)
class ServedDialect:
    """How `merap serve` speaks.

    Attributes:
        interface: what is served, in the order of the manager.
    """

    interface: Interface

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self.interface.actions

    def read(self, monitored: Mapping[str, Any]) -> Seen:
        """What `interface.monitor_schema` describes."""
        values = [monitored["valuation"][variable.name] for variable in self.interface.variables]
        reward = float(monitored["reward"])
        if not math.isfinite(reward):
            raise ValueError(f"a reward of {reward}")
        enabled = np.zeros(len(self.actions), dtype=np.bool_)
        enabled[[self.actions.index(name) for name in monitored["enabled"]]] = True
        action = monitored["action"]
        observation = Observation(
            valuation=np.array(values, dtype=np.int64),
            enabled=enabled,
            reward=reward,
            continuation=float(monitored["continuation"]),
            truncated=bool(monitored["truncated"]),
            detections=monitored["detections"],
        )
        return Seen(
            observation,
            None if action is None else self.actions.index(action),
            int(monitored["episode"]),
            int(monitored["step"]),
        )

    def change(self, action: int | None, last: Seen | None) -> Json:
        """What `interface.execute_schema` describes."""
        what: Json = {"reset": True} if action is None else {"action": self.actions[action]}
        return what if last is None else {**what, "episode": last.episode, "step": last.step}


class RemoteSystem(HttpSystem):
    """A system that `merap serve` offers; see `open_served`.

    Args:
        client: of its endpoints.
        interface: what it shows, in the order of the manager.
    """

    def __init__(self, client: UpisasClient, interface: Interface) -> None:
        super().__init__(client, ServedDialect(interface))
        self.interface = interface


def open_served(
    url: str,
    *,
    timeout: float = 5.0,
    actions: Sequence[str] | None = None,
    variables: Sequence[str] | None = None,
) -> RemoteSystem:
    """A system that `merap serve` offers, here or elsewhere.

    Args:
        url: where it is, as `http://localhost:3000`.
        timeout: seconds for each request.
        actions: in the order in which a manager numbers them, as `case.actions`; None: as served.
        variables: in the order of its valuations, as a hypothesis space has them; None: as served.

    Raises:
        InputError: the URL is none, or the system has other actions or variables.
        SystemFault: it can't be reached or does not behave.
    """
    client = UpisasClient(url, timeout)
    try:
        return RemoteSystem(client, _ordered(_served_interface(client), url, actions, variables))
    except (SystemFault, InputError):
        client.close()
        raise


def _served_interface(client: UpisasClient) -> Interface:
    options, schema = client.adaptation_options(), client.schema("monitor_schema")
    try:
        return read_interface(client.url, options, schema)
    except (KeyError, TypeError, ValueError) as error:
        raise SystemFault(
            "malformed", f"{client.url}: its options and monitor are not those of `merap serve`: {error!r}"
        ) from error


def _ordered(
    served: Interface, url: str, actions: Sequence[str] | None, variables: Sequence[str] | None
) -> Interface:
    names = [variable.name for variable in served.variables]
    for kind, wanted, found in (("actions", actions, served.actions), ("variables", variables, names)):
        if wanted is not None and sorted(wanted) != sorted(found):
            raise InputError(f"{url} has the {kind} {', '.join(found)}; expected {', '.join(wanted)}")
    return replace(
        served,
        actions=served.actions if actions is None else tuple(actions),
        variables=served.variables
        if variables is None
        else tuple(served.variables[names.index(name)] for name in variables),
    )
