"""Manage what `merap serve` offers.

Axes: A declared actions, V state variables.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jsonschema import Draft202012Validator

from merap.errors import InputError
from merap.systems.description import Interface, Json, monitor_schema, read_interface
from merap.systems.dialect import MonitoredState, first_misfit
from merap.systems.http_client import UpisasClient
from merap.systems.http_system import HttpSystem
from merap.systems.interface import Observation, SystemFault


@dataclass(frozen=True)
class ServedDialect:
    """The JSON of `merap serve`.

    Attributes:
        interface: the served actions and variables, in the order of the manager.
    """

    interface: Interface

    @property
    def actions(self) -> tuple[str, ...]:
        """A names."""
        return self.interface.actions

    @cached_property
    def _validator(self) -> Draft202012Validator:
        return Draft202012Validator(monitor_schema(self.interface))

    def read(self, monitored: Mapping[str, Any]) -> MonitoredState:
        """Read what `description.monitor_schema` describes.

        Raises:
            ValueError: it is something else, whatever the schema allows that was served.
        """
        misfit = first_misfit(self._validator, monitored)
        if misfit is not None:
            raise ValueError(f"not as `merap serve` answers{misfit}")
        if not math.isfinite(monitored["reward"]):
            raise ValueError(f"a reward of {monitored['reward']}")
        values = [monitored["valuation"][variable.name] for variable in self.interface.variables]
        enabled = np.zeros(len(self.actions), dtype=np.bool_)
        enabled[[self.actions.index(name) for name in monitored["enabled"]]] = True
        action = monitored["action"]
        observation = Observation(
            valuation=np.array(values, dtype=np.int64),
            enabled=enabled,
            reward=float(monitored["reward"]),
            continuation=float(monitored["continuation"]),
            truncated=bool(monitored["truncated"]),
            detections=monitored["detections"],
        )
        return MonitoredState(
            observation,
            None if action is None else self.actions.index(action),
            int(monitored["episode"]),
            int(monitored["step"]),
        )

    def change(self, action: int | None, last: MonitoredState | None) -> Json:
        """Build what `description.execute_schema` describes."""
        what: Json = {"reset": True} if action is None else {"action": self.actions[action]}
        return what if last is None else {**what, "episode": last.episode, "step": last.step}


class RemoteSystem(HttpSystem):
    """A system that `merap serve` offers; see `open_served`.

    Args:
        client: speaks to its endpoints.
        interface: its actions and variables, in the order of the manager.
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
    """Connect to a system that `merap serve` offers, here or elsewhere.

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
        return RemoteSystem(client, _ordered(_served_interface(client), client.url, actions, variables))
    except (SystemFault, InputError):
        client.close()
        raise


def _served_interface(client: UpisasClient) -> Interface:
    options, schema = client.adaptation_options(), client.schema("monitor_schema")
    try:
        return read_interface(client.url, options, schema)
    except (KeyError, TypeError, ValueError) as error:
        raise client.fault(
            "malformed",
            "GET /monitor_schema",
            f"its options and monitor are not those of `merap serve`: {error!r}",
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
