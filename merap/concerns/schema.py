"""Schema of the case file, and its JSON Schema for editors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, model_validator

from merap.concerns.combination import ResetMode
from merap.concerns.schema_base import Name, Settings, Spec, wrong
from merap.concerns.schema_capability import ActionSpec, InnateSpec
from merap.concerns.schema_configurations import ConcernSpec
from merap.concerns.schema_objective import MAX_HORIZON, ObjectiveSpec, Start
from merap.concerns.schema_space import SpaceSpec


class EnvironmentSpec(ConcernSpec):
    """The environment: what may be different about the surroundings.

    Its parameters `blocked` (locations) and `blocked_edges` (edges) have a meaning.
    """

    attributes: dict[str, Settings] = Field(
        default={},
        description="attributes that a configuration sets; a value may be the name of a parameter",
    )


class CapabilitySpec(ConcernSpec):
    """The capability: the actions of the system.

    Its parameter `no_entry` (locations) says where this system can't go.
    """

    actions: dict[Name, ActionSpec] = Field(default={}, description="external actions, in order")
    innate: InnateSpec | None = Field(default=None, description="the innate automaton")


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
    discount: float = Field(default=1.0, gt=0, le=1, description="of a step")
    space: SpaceSpec | None = Field(
        default=None, description="where the system moves; left out: nothing has a location"
    )
    environment: EnvironmentSpec = Field(default=EnvironmentSpec(), description="the environment")
    capability: CapabilitySpec = Field(description="what the system can do")
    objective: ObjectiveSpec = Field(description="what the user wants")
    online: dict[Name, SystemSpec] = Field(default={}, description="name: a system that is met online")

    @model_validator(mode="after")
    def _somewhere(self) -> CaseSpec:
        if self.space is not None and not self.objective.start:
            raise wrong("key 'start' is missing", ("objective",))
        return self
