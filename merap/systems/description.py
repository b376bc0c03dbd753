"""Describe the actions and variables that a managed system shows, and their JSON.

The bodies have the form that the UPISAS project asks of its exemplars: every body is an object, and the
keys of a schema's `properties` are those of the body, neither more nor fewer, so that a manager
which compares them is content. `/execute_schema` describes request and answer alike; a request may leave
out keys.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from merap.concerns.combination import Combination
from merap.program.form import Program
from merap.systems.interface import Observation, SystemFault
from merap.systems.places import spatial

Json = dict[str, Any]
MAX_NAMES = 10_000


@dataclass(frozen=True)
class ShownVariable:
    """A state variable.

    Attributes:
        name: name of the variable.
        low: its least value.
        high: its greatest value.
        names: names of its values from `low` on; None: they are numbers.
        boolean: whether it is true or false, 1 or 0; JSON has it so.
    """

    name: str
    low: int
    high: int
    names: tuple[str, ...] | None = None
    boolean: bool = False


@dataclass(frozen=True)
class Interface:
    """The actions and variables that a managed system shows.

    Attributes:
        system: its name.
        actions: A names.
        variables: V state variables, in the order of a valuation.
        detectors: names of the detectors that are read; their readings map locations to values.
        horizon: steps of an episode; None: not known.
    """

    system: str
    actions: tuple[str, ...]
    variables: tuple[ShownVariable, ...]
    detectors: tuple[str, ...] = ()
    horizon: int | None = None


def interface_of(combination: Combination, *, detect: bool) -> Interface:
    """Describe a simulated combination.

    Args:
        combination: the simulated one.
        detect: whether its detectors are read.
    """
    located = spatial(combination)
    return Interface(
        system=combination.name,
        actions=combination.actions,
        variables=shown_variables(combination.program),
        detectors=tuple(one.name for one in located.space.detectors) if detect and located else (),
        horizon=combination.objective.horizon,
    )


def shown_variables(program: Program) -> tuple[ShownVariable, ...]:
    """Return the variables that a simulated program shows, in the order of its valuations."""
    return tuple(
        ShownVariable(
            variable.name,
            variable.low,
            variable.high,
            variable.values if 0 < len(variable.values) <= MAX_NAMES else None,
            variable.kind == "bool",
        )
        for variable in program.variables
        if variable.name != program.flag
    )


def in_words(variable: ShownVariable, value: int) -> str:
    """Return a value by its name, as `true` or `false`, or as the number that it is."""
    if variable.boolean:
        return "true" if value else "false"
    if variable.names is None or not variable.low <= value <= variable.high:
        return str(value)
    return variable.names[value - variable.low]


def is_finite(value: object) -> bool:
    """Tell whether something is one finite real number, and no array."""
    return isinstance(value, Real) and math.isfinite(value)


def require_declared(seen: Observation, interface: Interface) -> None:
    """Refuse an observation that an interface does not allow; nothing is rounded or cut to fit.

    Raises:
        SystemFault: its kind is `malformed`; names the variable, its value, and what is allowed.
    """
    values, enabled = np.asarray(seen.valuation), np.asarray(seen.enabled)
    if values.shape != (len(interface.variables),) or not np.issubdtype(values.dtype, np.integer):
        raise _undeclared(interface, "valuation", seen.valuation, f"{len(interface.variables)} whole numbers")
    for variable, value in zip(interface.variables, values.tolist(), strict=True):
        if not variable.low <= value <= variable.high:
            raise _undeclared(interface, variable.name, value, f"{variable.low} to {variable.high}")
    if enabled.shape != (len(interface.actions),) or enabled.dtype != np.bool_:
        allowed = f"true or false for each of {len(interface.actions)} actions"
        raise _undeclared(interface, "enabled", seen.enabled, allowed)
    if not is_finite(seen.reward):
        raise _undeclared(interface, "reward", seen.reward, "a finite number")
    if not is_finite(seen.continuation) or not 0 <= seen.continuation <= 1:
        raise _undeclared(interface, "continuation", seen.continuation, "a number from 0 to 1")
    if not isinstance(seen.truncated, bool | np.bool_):
        raise _undeclared(interface, "truncated", seen.truncated, "true or false")


def _undeclared(interface: Interface, name: str, value: object, allowed: str) -> SystemFault:
    message = f"{interface.system} shows {name} {value!r}, expected {allowed}"
    return SystemFault("malformed", message, repeatable=False)


def monitor_schema(interface: Interface) -> Json:
    """Build the schema of the answers of `/monitor`."""
    action_names = list(interface.actions)
    limit = {} if interface.horizon is None else {"maximum": interface.horizon}
    return _object(
        {
            "valuation": _object({variable.name: _values(variable) for variable in interface.variables}),
            "enabled": {
                "type": "array",
                "items": {"enum": action_names},
                "uniqueItems": True,
                "description": "actions that are possible now",
            },
            "reward": _described("number", "earned by the last step; 0 after a reset"),
            "continuation": _described("number", "0 once the task is complete, else 1", minimum=0, maximum=1),
            "truncated": _described("boolean", "the horizon is reached though the task is not complete"),
            "detections": _object(dict.fromkeys(interface.detectors, _READINGS)),
            "action": {
                "enum": [*action_names, None],
                "description": "action of the last step; null after a reset",
            },
            "total": _described("number", "sum of the rewards of this episode"),
            **_COUNTERS,
            "step": {**_COUNTERS["step"], **limit},
        },
        title=f"observation of {interface.system}",
    )


def execute_schema(interface: Interface) -> Json:
    """Build the schema of requests to `/execute` and of its answers.

    A request has an `action` or `reset: true`. Its `episode` and `step` are the counters that were seen
    when it was decided: the request is refused if the system has gone on since, unless it is the very
    request that made it go on.
    """
    return {
        "title": f"action or reset of {interface.system}",
        "type": "object",
        "properties": {
            "action": {"enum": [*interface.actions, None], "description": "one of the enabled actions"},
            "reset": _described("boolean", "true: begin an episode"),
            **_COUNTERS,
        },
        "additionalProperties": False,
    }


def adaptation_options(interface: Interface) -> Json:
    """List all that `/execute` may ever ask for; `/monitor` tells what is possible now."""
    return {
        "action": {"type": "categorical", "values": list(interface.actions)},
        "reset": {"type": "categorical", "values": [False, True]},
    }


def adaptation_options_schema(interface: Interface) -> Json:
    """Build the schema of `adaptation_options`."""
    option = _object({"type": {"const": "categorical"}, "values": {"type": "array"}})
    return _object({"action": option, "reset": option}, title=f"adaptation options of {interface.system}")


def read_interface(name: str, options: Mapping[str, Any], schema: Mapping[str, Any]) -> Interface:
    """Read an interface from the `adaptation_options` and the `monitor_schema` that were served.

    Raises:
        KeyError, TypeError, ValueError: they are not of this form.
    """
    properties = schema["properties"]
    return Interface(
        system=name,
        actions=_names(options["action"]["values"]),
        variables=tuple(
            _read_variable(str(variable), entry)
            for variable, entry in properties["valuation"]["properties"].items()
        ),
        detectors=tuple(properties["detections"]["properties"]),
        horizon=properties["step"].get("maximum"),
    )


def _read_variable(name: str, entry: Mapping[str, Any]) -> ShownVariable:
    if entry.get("type") == "boolean":
        return ShownVariable(name, 0, 1, boolean=True)
    names = _names(entry["names"]) if "names" in entry else None
    return ShownVariable(name, int(entry["minimum"]), int(entry["maximum"]), names)


def _names(values: Any) -> tuple[str, ...]:
    if not values or not all(isinstance(value, str) for value in values):
        raise ValueError(f"expected names, got {values!r}")
    return tuple(values)


def _object(properties: Json, **more: Any) -> Json:
    return {
        **more,
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _described(kind: str, description: str, **more: Any) -> Json:
    return {"type": kind, "description": description, **more}


def _values(variable: ShownVariable) -> Json:
    if variable.boolean:
        return {"type": "boolean"}
    entry: Json = {"type": "integer", "minimum": variable.low, "maximum": variable.high}
    if variable.names is not None:
        entry["names"] = list(variable.names)
    return entry


_READINGS: Json = {
    "type": "object",
    "additionalProperties": {"type": ["boolean", "number"]},
    "description": "location -> reading there",
}
_COUNTERS: Json = {
    "episode": _described("integer", "number of resets so far, from 1 on", minimum=1),
    "step": _described("integer", "steps of this episode", minimum=0),
}
