"""Schema of the case file, and its JSON Schema for editors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    WithJsonSchema,
    model_validator,
)

from merap.concerns.combination import ResetMode
from merap.concerns.parameter_types import Parameter
from merap.concerns.schema_base import (
    LocationRef,
    Locations,
    Name,
    Names,
    Number,
    Settings,
    Spec,
    is_cell,
    is_number,
    location_ref,
    shown,
    wrong,
)
from merap.concerns.schema_capability import ActionSpec, InnateSpec
from merap.concerns.schema_processes import ProcessSpec
from merap.concerns.schema_space import SpaceSpec

MAX_HORIZON = 1_000_000


class ChoiceSpec(Spec):
    """The values that one parameter ranges over."""

    choose: int | None = Field(
        default=None, ge=1, le=1000, description="how many members, for locations and edges"
    )
    source: Any = Field(
        alias="from", description="locations, a box of cells, a list of values, or `all` of the domain"
    )
    without: Any = Field(alias="except", default=(), description="values that are left out")
    distinct: bool = Field(
        default=True, description="false: members may coincide, so fewer than choose remain"
    )


class GeneratedSpec(Spec):
    """A finite support: every combination of the parameters' choices."""

    generate: dict[str, ChoiceSpec] = Field(min_length=1, description="parameter: what it ranges over")
    require_reachable: bool = Field(
        default=False,
        description="environment: keep what leaves every goal reachable from every start location",
    )
    sample: int | None = Field(
        default=None, ge=1, le=1_000_000, description="draw that many distinct ones instead of all"
    )
    seed: int = Field(default=0, ge=0, description="of the draw")


NamedSpec: TypeAlias = dict[Name, dict[str, Any]]
_NAMED_SCHEMA = {
    "type": "object",
    "description": "name: values of the parameters",
    "minProperties": 1,
    "propertyNames": {"pattern": "^(?!generate$)[A-Za-z_][A-Za-z0-9_]*$"},
    "additionalProperties": {"type": "object"},
}


def _configurations_kind(value: Any) -> str | None:
    if isinstance(value, GeneratedSpec):
        return "<generated>"
    if not isinstance(value, Mapping):
        return None
    return "<generated>" if "generate" in value else "<named>"


Configurations = Annotated[
    Annotated[GeneratedSpec, Tag("<generated>")]
    | Annotated[NamedSpec, Tag("<named>"), WithJsonSchema(_NAMED_SCHEMA)],
    Discriminator(
        _configurations_kind,
        custom_error_type="merap",
        custom_error_message="expected a mapping of names to parameter values, or the key generate",
    ),
]


class EnvironmentSpec(Spec):
    """The spatial environment: what may be different about the space."""

    parameters: dict[Name, Parameter] = Field(
        default={}, description="name: type; `blocked` (locations) and `blocked_edges` (edges) have a meaning"
    )
    attributes: dict[str, Settings] = Field(
        default={},
        description="attributes that a configuration sets; a value may be the name of a parameter",
    )
    processes: dict[Name, ProcessSpec] = Field(
        default={}, description="name: variables that change with every step, in order of declaration"
    )
    configurations: Configurations = Field(description="named configurations, or a generated support")


class CapabilitySpec(Spec):
    """The capability: the actions of the system."""

    parameters: dict[Name, Parameter] = Field(
        default={}, description="name: type; `no_entry` (locations): where this system can't go"
    )
    actions: dict[Name, ActionSpec] = Field(default={}, description="external actions, in order")
    innate: InnateSpec | None = Field(default=None, description="the innate automaton")
    processes: dict[Name, ProcessSpec] = Field(
        default={}, description="name: variables that change with every step, in order of declaration"
    )
    configurations: Configurations = Field(description="named configurations, or a generated support")


class PredicateSpec(Spec):
    """States: location, mode and a condition; what is left out holds everywhere."""

    at: Locations | None = Field(default=None, description="locations, or a parameter that holds them")
    mode: Names | None = Field(default=None, description="a mode or several")
    where: str | None = Field(default=None, description="an expression over attributes and mode")


class EndSpec(PredicateSpec):
    """Steps: states and the actions taken there."""

    action: Names | None = Field(default=None, description="an action or several")


class RewardSpec(EndSpec):
    """A reward rule; the first that matches counts."""

    to: Locations | None = Field(default=None, description="location of the successor")
    to_mode: Names | None = Field(default=None, description="mode of the successor")
    value: Number = Field(description="a number or an expression; x' reads attribute x of the successor")


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


class ObjectiveSpec(Spec):
    """The objective: goal, rewards, and when the task is complete."""

    parameters: dict[Name, Parameter] = Field(
        default={}, description="name: type; `goal` (location or locations) is labelled `goal`"
    )
    start: Start = Field(
        default=(), description="a location, a parameter that holds one, or a distribution; goes with space"
    )
    horizon: int = Field(ge=1, le=MAX_HORIZON, description="steps of an episode")
    rewards: tuple[RewardSpec, ...] = Field(
        default=(), description="rules; the first that matches counts, no match earns 0"
    )
    ends_after: End | None = Field(default=None, description="steps that complete the task")
    ends_in: Predicate | None = Field(default=None, description="states in which the task is complete")
    unsafe: Predicate | None = Field(default=None, description="states to avoid")
    properties: dict[Name, str] = Field(
        default={}, description="name: PRISM property; labels goal, done, unsafe, deadlock"
    )
    processes: dict[Name, ProcessSpec] = Field(
        default={}, description="name: variables that change with every step, in order of declaration"
    )
    configurations: Configurations = Field(description="named configurations, or a generated support")


def _concern_kind(value: Any) -> str | None:
    return "<name>" if isinstance(value, str) else "<values>" if isinstance(value, Mapping) else None


Concern = Annotated[
    Annotated[str, Tag("<name>")] | Annotated[dict[str, Any], Tag("<values>")],
    Discriminator(
        _concern_kind,
        custom_error_type="merap",
        custom_error_message="expected the name of a configuration or a mapping of parameters to values",
    ),
]


class SystemSpec(Spec):
    """A system that is met online; a concern that has one configuration may be left out."""

    environment: Concern | None = Field(default=None, description="a configuration's name, or values")
    capability: Concern | None = Field(default=None, description="a configuration's name, or values")
    objective: Concern | None = Field(default=None, description="a configuration's name, or values")
    start: Start | None = Field(default=None, description="in place of the objective's")
    horizon: int | None = Field(default=None, ge=1, le=MAX_HORIZON, description="in place of the objective's")
    reset: ResetMode = Field(
        default="episodes",
        description="how an episode after the first begins: `episodes`: at a start; `return_to_start`: after "
        "the system's own way back there; `none`: where the last one ended",
    )


class CaseSpec(Spec):
    """A case study: the three concerns and the systems that are met online."""

    case: Name = Field(description="the name of the case study")
    discount: float = Field(gt=0, le=1, description="of a step")
    space: SpaceSpec | None = Field(
        default=None, description="where the system moves; left out: nothing has a location"
    )
    environment: EnvironmentSpec = Field(description="the spatial environment")
    capability: CapabilitySpec = Field(description="what the system can do")
    objective: ObjectiveSpec = Field(description="what the user wants")
    online: dict[Name, SystemSpec] = Field(default={}, description="name: a system that is met online")

    @model_validator(mode="after")
    def _somewhere(self) -> CaseSpec:
        if self.space is not None and not self.objective.start:
            raise wrong("key 'start' is missing", ("objective",))
        return self


def case_schema() -> dict[str, Any]:
    """The JSON Schema of a case file (draft 2020-12)."""
    schema = CaseSpec.model_json_schema(mode="validation")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "merap case file"}
