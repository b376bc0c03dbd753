"""`index.json` of a UMB archive: the part of its schema that merap reads and writes.

Source: the specification of the unified Markov binary format, version 1.0
(https://github.com/pmc-tools/umb, spec.md).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from merap.errors import InputError

FORMAT_VERSION: Literal[1] = 1

# A group of annotations that other tools pass over, for what UMB has no place for.
OWN_GROUP = "merap"
INITIAL_DISTRIBUTION = "initial-distribution"
BRANCH_REWARD = "branch-reward"

Count = Annotated[int, Field(ge=0, le=2**62)]
Bits = Annotated[int, Field(ge=1, le=2**16)]


def _key(name: str) -> str:
    """`num_states` is `#states` there, `applies_to` is `applies-to`."""
    plain = name.replace("_", "-")
    return "#" + plain.removeprefix("num-") if plain.startswith("num-") else plain


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, populate_by_name=True, alias_generator=_key)


class ValueType(_Record):
    """The type of a value and its size in bits; that of the type itself by default."""

    type: str
    size: Bits = 64

    @model_validator(mode="before")
    @classmethod
    def _fill_in_size(cls, data: object) -> object:
        if isinstance(data, dict) and data.get("type") == "bool":
            return {"size": 1, **data}
        return data


class TransitionSystem(_Record):
    """Kind and size of the model."""

    time: str
    num_players: Count
    num_states: Annotated[int, Field(ge=1, le=2**62)]
    num_initial_states: Count
    num_choices: Count
    num_choice_actions: Count
    num_branches: Count
    num_branch_actions: Count = 0
    num_observations: Count = 0
    branch_probability_type: ValueType | None = None


class Annotation(_Record):
    """Values attached to states, choices or branches."""

    alias: str | None = None
    applies_to: tuple[str, ...]
    type: ValueType


class Variable(_Record):
    """A bit field of a packed valuation: its value is what is stored plus `offset`."""

    name: str
    type: ValueType
    is_optional: bool = False
    lower: int | None = None
    upper: int | None = None
    offset: Annotated[int, Field(ge=-(2**63), lt=2**63)] = 0


class Padding(_Record):
    """Unused bits of a packed valuation."""

    padding: Bits


class ValuationClass(_Record):
    """The fields of a packed valuation, from the least significant bit upwards."""

    variables: tuple[Variable | Padding, ...]


class Valuations(_Record):
    """How the valuations of one kind of entity are packed."""

    unique: bool = False
    classes: tuple[ValuationClass, ...]


class Index(_Record):
    """The index of an archive."""

    format_version: Literal[1]
    format_revision: Count
    file_data: dict[str, object] = Field(default_factory=dict)
    transition_system: TransitionSystem
    annotations: dict[str, dict[str, Annotation]] = Field(default_factory=dict)
    valuations: dict[str, Valuations] = Field(default_factory=dict)


DOUBLE = ValueType(type="double", size=64)
BOOL = ValueType(type="bool", size=1)


def annotation_entry(group: str, identifier: str, kind: str) -> str:
    """Where an annotation's values for "states", "choices" or "branches" are."""
    return f"annotations/{group}/{identifier}/{kind}/values.bin"


def parse_index(content: bytes, source: str) -> Index:
    """The index as a checked record.

    Raises:
        InputError: it isn't JSON or doesn't follow the schema; names the key.
    """
    try:
        return Index.model_validate_json(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(("index.json", *map(str, first["loc"])))
        raise InputError(first["msg"], source=source, key=key) from error


def dump_index(index: Index) -> bytes:
    """The index as deterministic JSON."""
    return index.model_dump_json(by_alias=True, exclude_none=True, indent=2).encode()
