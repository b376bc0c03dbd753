"""Read and write `index.json` of a UMB archive: the part of its schema that merap uses.

Source: the specification of the unified Markov binary format, version 1.0
(https://github.com/pmc-tools/umb, spec.md).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from merap.errors import InputError, quoted_if_odd

FORMAT_VERSION: Literal[1] = 1

# A group of annotations that other tools pass over, for data that UMB has no place for.
OWN_GROUP = "merap"
INITIAL_DISTRIBUTION = "initial-distribution"
BRANCH_REWARD = "branch-reward"

Count = Annotated[int, Field(ge=0, le=2**62)]
Bits = Annotated[int, Field(ge=1, lt=2**32)]

# The sizes of types in bits where the index names none.
_DEFAULT_SIZES = {
    "bool": 1,
    "int-interval": 128,
    "uint-interval": 128,
    "double-interval": 128,
    "rational": 128,
    "rational-interval": 256,
}


def _key(name: str) -> str:
    """Return a field's key in the file: `#states` for `num_states`, `applies-to` for `applies_to`."""
    plain = name.replace("_", "-")
    return "#" + plain.removeprefix("num-") if plain.startswith("num-") else plain


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, populate_by_name=True, alias_generator=_key)


class ValueType(_Record):
    """The type of a value and its size in bits, which each type has a default for."""

    type: str
    size: Bits = 64

    @model_validator(mode="before")
    @classmethod
    def _fill_in_size(cls, data: object) -> object:
        if isinstance(data, dict) and isinstance(data.get("type"), str):
            return {"size": _DEFAULT_SIZES.get(data["type"], 64), **data}
        return data

    @property
    def is_real(self) -> bool:
        """Tell whether it is a double or a rational, of a size that these may have."""
        return self == DOUBLE or (self.type == "rational" and self.size % 128 == 0)


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
    exit_rate_type: ValueType | None = None
    player_names: tuple[str, ...] | None = None


class Annotation(_Record):
    """Values attached to states, choices or branches."""

    alias: str | None = None
    applies_to: Annotated[tuple[str, ...], Field(min_length=1)]
    type: ValueType

    def name(self, identifier: str) -> str:
        """Return the name that the annotation goes by: its alias, else its identifier."""
        return identifier if self.alias is None else self.alias


class PackedVariable(_Record):
    """A bit field of a packed valuation: its value is the stored number plus `offset`."""

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

    variables: tuple[PackedVariable | Padding, ...]


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
    """Return the entry with an annotation's values for "states", "choices" or "branches"."""
    return f"annotations/{group}/{identifier}/{kind}/values.bin"


def parse_index(content: bytes, source: str) -> Index:
    """Parse and check the index.

    Raises:
        InputError: it isn't JSON or doesn't follow the schema; names the key.
    """
    try:
        return Index.model_validate_json(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(("index.json", *(quoted_if_odd(str(part)) for part in first["loc"])))
        raise InputError(first["msg"], source=source, key=key) from error


def dump_index(index: Index) -> bytes:
    """Write the index as JSON; equal indices give equal bytes."""
    return index.model_dump_json(by_alias=True, exclude_none=True, indent=2).encode()
