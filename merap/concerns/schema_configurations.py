"""Schema of what every concern has: parameters, processes and configurations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

from pydantic import Discriminator, Field, Tag, WithJsonSchema, model_validator

from merap.concerns.parameter_types import Parameter
from merap.concerns.schema_base import Name, Spec, wrong
from merap.concerns.schema_processes import ProcessSpec


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


def _default_configuration() -> NamedSpec:
    return {"default": {}}


class ConfiguredSpec(Spec):
    """Parameters and their values; without parameters there is the one configuration `default`."""

    parameters: dict[Name, Parameter] = Field(default={}, description="name: type")
    configurations: Configurations = Field(
        default_factory=_default_configuration, description="named configurations, or a generated support"
    )

    @model_validator(mode="after")
    def _configured(self) -> ConfiguredSpec:
        if self.parameters and "configurations" not in self.model_fields_set:
            raise wrong("key 'configurations' is missing: which values the parameters have")
        return self


class ConcernSpec(ConfiguredSpec):
    """A concern of the case language."""

    processes: dict[Name, ProcessSpec] = Field(
        default={}, description="name: variables that change with every step, in order of declaration"
    )
