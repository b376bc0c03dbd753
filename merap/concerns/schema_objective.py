"""Schema of the objective: rewards, ends, and the conditions that they have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainValidator, WithJsonSchema

from merap.concerns.schema_base import (
    SET_SCHEMA,
    LocationRef,
    Locations,
    LocationSet,
    Name,
    Names,
    Number,
    Spec,
    Truth,
    is_cell,
    is_number,
    is_whole,
    location_ref,
    location_set,
    shown,
    wrong,
)
from merap.concerns.schema_configurations import ConcernSpec

MAX_HORIZON = 1_000_000


class PredicateSpec(Spec):
    """States: location, mode and a condition; what is left out holds everywhere."""

    at: Locations | None = Field(default=None, description="locations, or a parameter that holds them")
    mode: Names | None = Field(default=None, description="a mode or several")
    where: str | None = Field(default=None, description="an expression")


class EndSpec(PredicateSpec):
    """Steps: states and the actions taken there."""

    action: Names | None = Field(default=None, description="an action or several")


@dataclass(frozen=True)
class Successor:
    """What a step leads to.

    Attributes:
        at: locations; None: anywhere.
        values: variable, attribute or `mode` -> what it becomes, a value or an expression.
    """

    at: LocationSet | None
    values: Mapping[str, bool | int | float | str]


def _successor(given: Any) -> Successor:
    if not isinstance(given, Mapping) or set(given) == {"rows", "cols"}:
        return Successor(location_set(given), {})
    values = {name: value for name, value in given.items() if name != "at"}
    for name, value in values.items():
        if not isinstance(value, bool | int | float | str):
            raise wrong(f"expected a value or an expression, got {shown(value)}", (name,))
    return Successor(location_set(given["at"], path=("at",)) if "at" in given else None, values)


_VALUES = {"type": ["number", "boolean", "string"]}
To = Annotated[
    Successor,
    PlainValidator(_successor),
    WithJsonSchema(
        {
            "anyOf": [
                SET_SCHEMA,
                {
                    "type": "object",
                    "properties": {"at": SET_SCHEMA},
                    "additionalProperties": _VALUES,
                    "description": "locations, and what variables become",
                },
            ]
        }
    ),
]


class RewardSpec(EndSpec):
    """A reward rule; the first that matches counts."""

    to: To | None = Field(
        default=None, description="locations of the successor, or a mapping of at and of variables to values"
    )
    to_mode: Names | None = Field(default=None, description="mode of the successor")
    value: Number = Field(description="a number or an expression; x' reads x of the successor")


def _condition(value: Any) -> Any:
    return {"where": value} if isinstance(value, str) else value


Predicate = Annotated[PredicateSpec, BeforeValidator(_condition, json_schema_input_type=str | PredicateSpec)]
End = Annotated[EndSpec, BeforeValidator(_condition, json_schema_input_type=str | EndSpec)]


@dataclass(frozen=True)
class StartPoint:
    """A start location and its probability."""

    at: LocationRef
    probability: int | float


def _start(value: Any) -> tuple[StartPoint, ...]:
    if isinstance(value, str) or is_cell(value):
        return (StartPoint(location_ref(value), 1),)
    if isinstance(value, Mapping):
        return tuple(_start_point(name, prob, (name,)) for name, prob in value.items())
    if isinstance(value, tuple) and value and all(isinstance(entry, Mapping) for entry in value):
        return tuple(_listed_start(entry, index) for index, entry in enumerate(value))
    raise wrong(
        "expected a location, a mapping of locations to probabilities, or a list of entries with at and "
        f"probability; got {shown(value)}"
    )


def _listed_start(entry: Mapping[str, Any], index: int) -> StartPoint:
    if set(entry) != {"at", "probability"}:
        raise wrong(f"expected a mapping with the keys at and probability, got {shown(entry)}", (index,))
    return _start_point(entry["at"], entry["probability"], (index,))


def _start_point(at: Any, probability: Any, path: tuple[str | int, ...]) -> StartPoint:
    if not (isinstance(at, str) or is_cell(at)):
        raise wrong(f"expected a location, got {shown(at)}", path)
    if not is_number(probability) or not 0 <= probability <= 1:
        raise wrong(f"expected a probability in [0, 1], got {shown(probability)}", path)
    return StartPoint(location_ref(at), probability)


Start = Annotated[
    tuple[StartPoint, ...],
    PlainValidator(_start),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string", "description": "a location, or a parameter that holds one"},
                {"type": "array", "description": "[row, col], or a list of entries with at and probability"},
                {"type": "object", "additionalProperties": {"type": "number", "minimum": 0, "maximum": 1}},
            ]
        }
    ),
]


def _horizon(given: Any) -> int | str:
    if isinstance(given, str):
        return given
    if is_whole(given) and 1 <= given <= MAX_HORIZON:
        return int(given)
    raise wrong(f"expected a whole number from 1 to {MAX_HORIZON}, or a parameter, got {shown(given)}")


Horizon = Annotated[
    int | str,
    PlainValidator(_horizon),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "integer", "minimum": 1, "maximum": MAX_HORIZON},
                {"type": "string", "description": "a parameter of type int"},
            ]
        }
    ),
]


class ObjectiveSpec(ConcernSpec):
    """The objective: goal, rewards, and when the task is complete."""

    start: Start = Field(
        default=(), description="a location, a parameter that holds one, or a distribution; goes with space"
    )
    horizon: Horizon = Field(description="steps of an episode: a number, or a parameter")
    goal: Predicate | None = Field(
        default=None, description="states labelled `goal`; left out: at the parameter `goal`, if there is one"
    )
    labels: dict[Name, Truth] = Field(
        default={}, description="name: a condition on the state, which expressions read in double quotes"
    )
    rewards: tuple[RewardSpec, ...] = Field(
        default=(), description="rules; the first that matches counts, no match earns 0"
    )
    ends_after: End | None = Field(default=None, description="steps that complete the task")
    ends_in: Predicate | None = Field(default=None, description="states in which the task is complete")
    unsafe: Predicate | None = Field(default=None, description="states to avoid")
    properties: dict[Name, str] = Field(
        default={}, description="name: PRISM property; labels goal, done, unsafe, deadlock and own ones"
    )
